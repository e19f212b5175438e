"""How often each band of a signal is above its usual share of the spectrum.

MiniRocket (Dempster et al. 2021) classifies time series by the proportion of positive values of
many convolutions. Here the convolutions are the bands of two short-time spectra: a feature has a
frequency and a threshold, and the window and its bands depend on the data's own rate.
"""

import math
from collections.abc import Iterable, Sequence

import scipy  # whose parts are loaded when they are used
import torch
from torch import Tensor, nn

from tex_lightning.errors import UserError
from tex_lightning.senses.features.spectrogram import (
    check_window,
    mean_filters,
    movement_start,
    triangles,
)

OVERLAP = 4  # frames that every sample is in
LIMITS = {"windows": 16, "bands_per_octave": 48, "thresholds": 64}
KEPT = 2000  # frames of a recording, at most, that thresholds are learnt from
FLOOR = 1e-7  # of the mean power of the training set; below it the logarithm is flat


class BandProportions(nn.Module):
    """Proportions of time that bands are above thresholds, for each fragment of the movement.

    The bands of a frame, triangles even in the logarithm of frequency from one period of the window
    up to half the rate, are compared with the frame's mean and with the band a third of an octave
    below, so that neither the strength of a stroke nor the sensor's gain matters. Thresholds
    are quantiles over the training set, without labels. Axes are joined by adding their power.

    Args:
        sampling_rate: Rate of the signals in Hz.
        windows: Lengths of the Hann windows in seconds, rounded up to a number of samples with a
            fast transform; a short one resolves the order of events, a long one low bands.
        bands_per_octave: How finely frequency is divided.
        thresholds: Number of thresholds for each band.
        fragment_seconds: Approximate length of a fragment; a movement is cut into equal ones.
        skip_impact: Leave out the part before steady movement.

    Raises:
        UserError: If a window at this rate has no band.

    Attributes:
        bands: Number of features of a fragment.
    """

    level: Tensor

    def __init__(
        self,
        *,
        sampling_rate: float,
        windows: Sequence[float],
        bands_per_octave: int,
        thresholds: int,
        fragment_seconds: float,
        skip_impact: bool,
    ) -> None:
        super().__init__()
        numbers = (len(windows), bands_per_octave, thresholds)
        for (name, most), number in zip(LIMITS.items(), numbers, strict=True):
            if not 1 <= number <= most:
                raise UserError(f"features.{name}: give 1 to {most}, not {number}.")
        if not fragment_seconds > 0:
            raise UserError("features.fragment_seconds has to be more than 0 s.")
        for seconds in windows:
            length = min(seconds * sampling_rate, 1e9)
            check_window(round(length), max(1, round(length / OVERLAP)), sampling_rate)
        self.sampling_rate, self.skip_impact = sampling_rate, skip_impact
        self.fragment_seconds, self.gap = fragment_seconds, max(1, bands_per_octave // 3)
        self.lengths = [
            scipy.fft.next_fast_len(max(2, round(each * sampling_rate))) for each in windows
        ]
        self.bands = 0
        self.register_buffer("level", torch.ones(()))
        for index, length in enumerate(self.lengths):
            filters = octave_filters(sampling_rate, length, bands_per_octave)
            channels = 2 * len(filters) - self.gap
            if channels < 1:
                raise UserError(
                    f"A window of {length} samples at {sampling_rate:g} Hz has no band; choose "
                    "longer features.windows."
                )
            self.bands += channels * thresholds
            window = torch.hann_window(length, periodic=False)
            self.register_buffer(f"window{index}", window, persistent=False)
            self.register_buffer(f"filters{index}", filters.T.contiguous(), persistent=False)
            self.register_buffer(f"thresholds{index}", torch.zeros(channels, thresholds))

    def responses(self, trace: Tensor) -> list[Tensor]:
        """Bands relative to their frame's mean, then to the bands below, for each window.

        Args:
            trace: (axes, samples).

        Returns:
            (channels, frames) for each window.

        Raises:
            UserError: If the movement is shorter than the longest window.
        """
        if self.skip_impact:
            trace = trace[:, movement_start(trace, self.sampling_rate) :]
        least = max(self.lengths)
        if trace.shape[-1] < least:
            raise UserError(
                f"The signal has {trace.shape[-1] / self.sampling_rate:.2f} s of movement, less "
                f"than one window of {least / self.sampling_rate:g} s; record a longer stroke."
            )
        return [self._responses(trace, index) for index in range(len(self.lengths))]

    def _responses(self, trace: Tensor, index: int) -> Tensor:
        length = self.lengths[index]
        window, filters = self.get_buffer(f"window{index}"), self.get_buffer(f"filters{index}")
        frames = trace.unfold(-1, length, max(1, round(length / OVERLAP)))
        frames = (frames - frames.mean(dim=-1, keepdim=True)) * window
        power = torch.view_as_real(torch.fft.rfft(frames)).square().sum(dim=(0, -1))
        power = power @ filters / window.sum().square()
        bands = (power / self.level).add_(FLOOR).log_().T
        return torch.cat((bands - bands.mean(dim=0), bands[self.gap :] - bands[: -self.gap]))

    def learn(self, traces: Iterable[Tensor]) -> None:
        """Take the level and the thresholds from the training set.

        Args:
                traces: (axes, samples) each.
        """
        traces = list(traces)
        powers = [trace.var(dim=-1, correction=0).sum() for trace in traces]
        level = torch.stack(powers).mean()
        self.level.copy_(level if level > 0 else torch.ones_like(level))
        found = [[_thinned(each) for each in self.responses(trace)] for trace in traces]
        for index, each in enumerate(zip(*found, strict=True)):
            ordered = torch.cat(each, dim=1).sort(dim=1).values
            thresholds = self.get_buffer(f"thresholds{index}")
            count = thresholds.shape[1]
            shares = (torch.arange(count, dtype=torch.float64) + 0.5) / count
            places = (shares * ordered.shape[1]).long().to(ordered.device)
            thresholds.copy_(ordered[:, places])

    def forward(self, trace: Tensor) -> Tensor:
        """Trace (axes, samples) to proportions (1, 1, bands, fragments)."""
        responses = self.responses(trace)
        seconds = trace.shape[-1] / self.sampling_rate
        fewest = min(each.shape[1] for each in responses)
        count = min(fewest, max(1, round(seconds / self.fragment_seconds)))
        parts = [self._proportions(each, index, count) for index, each in enumerate(responses)]
        return torch.cat(parts)[None, None]

    def _proportions(self, responses: Tensor, index: int, fragments: int) -> Tensor:
        """(channels * thresholds, fragments)."""
        limits = self.get_buffer(f"thresholds{index}")
        above = (responses[:, None] > limits[..., None]).flatten(0, 1).to(responses.dtype)
        frames = above.shape[1]
        place = torch.arange(frames, device=above.device) * fragments // frames
        member = nn.functional.one_hot(place, fragments).to(above.dtype)
        return above @ (member / member.sum(dim=0))


def octave_filters(sampling_rate: float, samples: int, per_octave: int) -> Tensor:
    """Triangles even in the logarithm of frequency that take the mean power of each band.

    A triangle reaches to the centres of its neighbours, and at least to the neighbouring channels
    of the transform, so that every band has one; none has the constant part.

    Args:
        sampling_rate: Sampling rate in Hz.
        samples: Length of the transform.
        per_octave: Bands in an octave.

    Returns:
        (bands, samples // 2 + 1), not negative, rows summing to 1; from one period of the window up
        to half the rate.
    """
    channel = sampling_rate / samples
    bands = int(per_octave * math.log2(samples / 2) + 1e-6)
    centres = channel * 2 ** (torch.arange(bands, dtype=torch.float64)[:, None] / per_octave)
    step = 2 ** (1 / per_octave)
    below = torch.minimum(centres / step, centres - channel)
    above = torch.maximum(centres * step, centres + channel)
    frequencies = torch.arange(samples // 2 + 1, dtype=torch.float64) * channel
    heights = triangles(frequencies, below, centres, above)
    heights[:, 0] = 0
    return mean_filters(heights)


def _thinned(responses: Tensor) -> Tensor:
    return responses[:, :: math.ceil(responses.shape[1] / KEPT)]
