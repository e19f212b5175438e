"""From a raw trace to the normalised spectrogram that HapticNet reads (paper, section III-B)."""

from collections.abc import Sequence
from typing import Literal, cast

import torch
from torch import Tensor, nn

from tex_lightning.errors import UserError
from tex_lightning.features.dft321 import dft321

Normalisation = Literal["standard", "paper"]

QUIET_SECONDS = 0.1  # the level before the touch is taken over this time
IMPACT_FACTOR = 20.0  # a touch is this many times louder than the quiet before it
SETTLING_SECONDS = 0.2  # from the touch to steady movement
SEARCH_SECONDS = 2.0  # later bursts are part of the movement
FLOOR = 1e-3  # of the training set's mean magnitude; below it the logarithm is flat


class HapticFeatures(nn.Module):
    """Movement segment, DFT321, Hamming spectrogram of the low channels, normalisation.

    Convention: channel ``k`` is the magnitude at ``k * sampling_rate / window_length`` Hz (at
    10 kHz 0 to 980 Hz in steps of 20), frame ``t`` starts at sample ``t * hop_length`` of the
    movement and frames that would pass its end are left out. ``standard`` takes the logarithm and
    standardises every channel with the mean and deviation of the training set, so that the level
    and the spectral envelope of a trace count; a channel that never varies becomes zero.
    ``paper`` brings every channel of every trace to [0, 1]; a constant channel becomes zero.

    Args:
        sampling_rate: Rate of the traces in Hz.
        normalisation: ``standard`` (needs :meth:`fit`) or ``paper``.
        skip_impact: Leave out what comes before steady movement.
    """

    window: Tensor
    level: Tensor
    channel_mean: Tensor
    channel_std: Tensor

    window_length = 500
    hop_length = 100
    bands = 50

    def __init__(
        self,
        *,
        sampling_rate: float = 10_000.0,
        normalisation: str = "standard",
        skip_impact: bool = True,
    ) -> None:
        super().__init__()
        self.sampling_rate = sampling_rate
        self.normalisation = cast(Normalisation, normalisation)
        self.skip_impact = skip_impact
        # symmetric, as MATLAB's hamming(500)
        window = torch.hamming_window(self.window_length, periodic=False)
        self.register_buffer("window", window, persistent=False)
        self.register_buffer("level", torch.ones(()))
        self.register_buffer("channel_mean", torch.zeros(self.bands, 1))
        self.register_buffer("channel_std", torch.ones(self.bands, 1))

    def count_frames(self, trace: Tensor) -> int:
        """Frames that :meth:`magnitudes` will give for a trace (axes, samples); 0 if too short."""
        samples = trace.shape[-1]
        if self.skip_impact:
            samples -= movement_start(trace, self.sampling_rate)
        return max(0, (samples - self.window_length) // self.hop_length + 1)

    def magnitudes(self, trace: Tensor) -> Tensor:
        """Spectrogram before normalisation.

        Args:
            trace: (axes, samples), one or three axes.

        Returns:
            Magnitudes (bands, frames), not negative.

        Raises:
            UserError: If the trace is shorter than one window.
        """
        if self.skip_impact:
            trace = trace[:, movement_start(trace, self.sampling_rate) :]
        samples = trace.shape[-1]
        if samples < self.window_length:
            raise UserError(
                f"The trace has {samples / self.sampling_rate:.2f} s of movement, less than one "
                f"window of {self.window_length} samples; record a longer stroke."
            )
        mono = dft321(trace) if trace.shape[0] == 3 else trace[0] - trace[0].mean()
        spectrum = torch.stft(
            mono,
            self.window_length,
            self.hop_length,
            window=self.window,
            center=False,
            return_complex=True,
        )
        return spectrum[: self.bands].abs()

    def fit(self, magnitudes: Sequence[Tensor]) -> None:
        """Learn level, mean and deviation from the training set's magnitudes (bands, frames)."""
        if self.normalisation == "paper":
            return
        frames = torch.cat(list(magnitudes), dim=1)
        level = frames.mean()
        self.level.copy_(level if level > 0 else torch.ones_like(level))
        logs = self._log(frames)
        std = logs.std(dim=1, keepdim=True)
        self.channel_mean.copy_(logs.mean(dim=1, keepdim=True))
        self.channel_std.copy_(torch.where(std > 1e-6, std, torch.ones_like(std)))

    def normalise(self, magnitudes: Tensor) -> Tensor:
        """Normalise magnitudes (bands, frames) to the network's input of the same shape."""
        if self.normalisation == "standard":
            return (self._log(magnitudes) - self.channel_mean) / self.channel_std
        low = magnitudes.amin(dim=1, keepdim=True)
        span = magnitudes.amax(dim=1, keepdim=True) - low
        return (magnitudes - low) / torch.where(span > 0, span, torch.ones_like(span))

    def forward(self, trace: Tensor) -> Tensor:
        """Trace (axes, samples) to network input (1, 1, bands, frames)."""
        return self.normalise(self.magnitudes(trace))[None, None]

    def _log(self, magnitudes: Tensor) -> Tensor:
        return torch.log(magnitudes / self.level + FLOOR)


def movement_start(trace: Tensor, sampling_rate: float) -> int:
    """First sample of steady movement: 0.2 s after a touch that breaks a quiet beginning.

    A recording that starts while the tool already moves has no such touch and is kept whole.

    Args:
        trace: (axes, samples).
        sampling_rate: In Hz.
    """
    quiet = int(QUIET_SECONDS * sampling_rate)
    search = int(SEARCH_SECONDS * sampling_rate)
    if trace.shape[-1] <= quiet:
        return 0
    # the median is gravity or an offset: a mean would be drawn towards the movement
    strength = (trace - trace[:, :quiet].median(dim=-1, keepdim=True).values).norm(dim=0)
    loud = strength[quiet:search] > IMPACT_FACTOR * strength[:quiet].mean()
    onset = int(loud.int().argmax()) if loud.any() else None
    if onset is None:
        return 0
    return quiet + onset + int(SETTLING_SECONDS * sampling_rate)
