"""Bands of the short-time spectrum under one window, and how often they exceed thresholds."""

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np
import scipy  # whose parts are loaded when they are used
import torch
from torch import Tensor, nn

from tex_lightning.core.devices import is_at_hand
from tex_lightning.senses.features.moments import Moments
from tex_lightning.senses.features.spectrogram import mean_filters
from tex_lightning.senses.features.usual_bands import UsualBands

OVERLAP = 4  # frames that every sample is in
LONGEST_ODD = 1024  # samples; transforms of more are fast if they can be halved
RANGES = 3  # of bands, each of which is a product of its own: low bands take few channels
BLOCK = 1 << 18  # samples of frames that are computed at once, about, so that they stay in cache
MIN_BLOCK, MAX_BLOCK = 64, 1024  # frames
FLOOR = 1e-7  # of the power of a frame; below it the logarithm is flat
SILENCE = 1e-15  # of the mean power of the training set, likewise
SHAPE, POWER = "shape", "power"  # kinds of blocks of proportions
AXES, AXES_POWER = "axes", "axes_power"  # the same of every axis by itself
MEAN, DEVIATION = "mean", "deviation"


class OctaveBands(nn.Module):
    """Log power of bands that are even in octaves, compared in three ways, or four if slow.

    The comparisons are with the mean of the frame, with the band a third of an octave below, with
    itself one window earlier, and with the mean power of the training set.

    Args:
        sampling_rate: Sampling rate in Hz.
        length: Samples of the Hann window.
        per_octave: Bands in an octave.
        thresholds: Number of thresholds for each band.
        slow: Whether the signal is slow, so that levels count.
        apart: Number of axes whose bands also count one by one.

    Attributes:
        detrends: Whether frames lose their linear trend as well as their mean.
        hop: Samples between the starts of frames.
        sizes: Number of bands in each comparison.
        blocks: Kind and number of features of each block, in their order.
        usual: What the bands usually are, for recordings in which some are empty.
        thresholds: (thresholds, channels).
    """

    detrends = False
    window: Tensor
    slope: Tensor
    filters: Tensor
    thresholds: Tensor

    def __init__(
        self,
        sampling_rate: float,
        length: int,
        per_octave: int,
        *,
        thresholds: int,
        slow: bool,
        apart: int,
    ) -> None:
        super().__init__()
        self.length, self.hop = length, max(1, round(length / OVERLAP))
        self.gap, self.slow, self.apart = third(per_octave), slow, apart
        filters = octave_filters(sampling_rate, length, per_octave)
        bands = len(filters)
        self.sizes = (bands, bands - self.gap, bands, bands)[: 4 if slow else 3]
        edges = [bands * part // RANGES for part in range(RANGES + 1)]
        parts = [slice(*pair) for pair in pairwise(edges)]
        self.ranges = [(part, _reach(filters[part])) for part in parts]
        channels = sum(self.sizes) * (1 + apart)
        window = torch.hann_window(length, periodic=False)
        window /= window.sum()  # so that power is that of the signal
        slope = torch.linspace(-1, 1, length, dtype=torch.float64)
        slope = (slope / slope.norm()).to(window.dtype)
        self.register_buffer("window", window, persistent=False)
        self.register_buffer("slope", slope, persistent=False)
        self.register_buffer("filters", filters.T.contiguous(), persistent=False)
        self.register_buffer("thresholds", torch.zeros(thresholds, channels))
        self.usual = UsualBands(self.sizes, self.gap, slow=slow, apart=apart)
        self.blocks = self._blocks(thresholds)
        self.width = sum(size for _, size in self.blocks)

    def _blocks(self, thresholds: int) -> list[tuple[str, int]]:
        shares = [size * thresholds for size in self.sizes]
        blocks = [*zip((SHAPE, SHAPE, SHAPE, POWER), shares, strict=False)]
        if self.apart:
            kinds = AXES, AXES, AXES, AXES_POWER
            blocks += [(kind, n * self.apart) for kind, n in zip(kinds, shares, strict=True)]
        blocks += [(MEAN, size) for size in self.sizes[:2]]
        return blocks + ([(DEVIATION, sum(self.sizes))] if self.slow else [])

    @property
    def bins(self) -> list[int]:
        """The band of each feature, of a signal that is not slow."""
        bands, count = torch.arange(self.sizes[0]), len(self.thresholds)
        means = bands, bands[self.gap :]
        shares = [part.repeat_interleave(count) for part in (*means, bands)]
        return [*map(int, torch.cat((*shares, *means)))]

    def count_frames(self, samples: int) -> int:
        """Return how many frames so many samples have."""
        return (samples - self.length) // self.hop + 1

    def responses(
        self, movement: Tensor, mean_power: Tensor, first: int = 0, last: int | None = None
    ) -> Tensor:
        """Return what is compared with thresholds: (frames, channels), block after block.

        Args:
            movement: (axes, samples).
            mean_power: Mean power () of the training set.
            first: First frame.
            last: One past the last frame; None takes all.
        """
        before = max(0, first - OVERLAP)  # frames that the first ones are compared with
        frames = movement.unfold(-1, self.length, self.hop)[:, before:last]
        frames = frames - frames.mean(dim=-1, keepdim=True)
        if self.detrends:
            frames.addcmul_((frames @ self.slope)[..., None], self.slope, value=-1)
        squares = torch.view_as_real(torch.fft.rfft(frames.mul_(self.window))).square_()
        power = squares[..., 0] + squares[..., 1]
        power = power if self.apart else joined(power)
        sums = [
            power[..., channels] @ self.filters[channels, bands] for bands, channels in self.ranges
        ]
        return self.compare(torch.cat(sums, dim=-1), mean_power)[first - before :]

    def in_blocks(self, movement: Tensor, mean_power: Tensor, begin: int = 0) -> Iterator[Tensor]:
        """Yield the same as :meth:`responses` some frames (block, channels) at a time.

        Memory then does not grow with the movement (axes, samples). ``begin`` is the first frame.
        """
        frames = self.count_frames(movement.shape[-1])
        size = BLOCK // (len(movement) * self.length)
        size = min(max(size, MIN_BLOCK), MAX_BLOCK)
        for first in range(begin, frames, size):
            yield self.responses(movement, mean_power, first, min(frames, first + size))

    def compare(self, power: Tensor, mean_power: Tensor) -> Tensor:
        """Compare power (axes, frames, bands) of all axes together, and of each if they count.

        Returns:
            (frames, channels), as :meth:`responses`; NaN where a band is empty.
        """
        responses = []
        for part in (joined(power), power)[: 1 + bool(self.apart)]:
            # a floor of the frame's own power, so that gain leaves its shape
            floor = FLOOR * part.mean(dim=2, keepdim=True) + SILENCE * mean_power
            logs = (part + floor).div_(mean_power).log_()
            logs, mean = self.usual.without_empty(logs, logs.mean(dim=2, keepdim=True))
            responses.append(compared(logs, mean, self.gap, len(self.sizes)))
        return responses[0] if len(responses) == 1 else torch.cat(responses, dim=1)

    def thinned(self, movement: Tensor, mean_power: Tensor, kept: int) -> Tensor:
        """Return at most so many rows of responses at equal distances, and at least one."""
        frames = self.count_frames(movement.shape[-1])
        step, first, parts = math.ceil(frames / max(1, kept)), 0, []
        for responses in self.in_blocks(movement, mean_power):
            parts.append(responses[-first % step :: step].clone())
            first += len(responses)
        return torch.cat(parts)

    def learn(self, responses: Tensor) -> None:
        """Set thresholds to quantiles of responses (frames, channels) in the training."""
        count, frames = len(self.thresholds), len(responses)
        shares = (torch.arange(count, dtype=torch.float64) + 0.5) / count
        places = (shares * frames).long().to(responses.device)
        after = (places + 1).clamp_max(frames - 1)  # between two: no rounding crosses it
        every = torch.arange(responses.shape[1], device=responses.device)
        for channels in torch.split(every, max(1, BLOCK // frames)):
            ordered = _ordered(responses[:, channels].T)
            self.thresholds[:, channels] = ((ordered[:, places] + ordered[:, after]) / 2).T
        self.usual.learn(responses)

    def summary(self, blocks: Iterable[Tensor], frames: int, fragments: int) -> Tensor:
        """Return the features (D, fragments).

        Args:
            blocks: Responses (block, channels), one block after the other.
            frames: Number of all frames.
            fragments: Number of equal fragments.
        """
        limits, bands = self.thresholds, self.sizes
        moments = Moments(frames, fragments)
        for responses in blocks:  # as numbers: faster than a comparison as booleans
            found = responses.new_empty(responses.shape[0], *limits.shape)
            found = torch.gt(responses[:, None], limits, out=found)
            kept = responses[:, : sum(bands if self.slow else bands[:2])]
            if self.usual.has_empty(responses):
                found, kept = self.usual.fill(responses, found, kept)
            moments.add(found.flatten(1), kept, squares=self.slow)
        above, means = moments.means
        shares = above.reshape(-1, *limits.shape).transpose(1, 2).flatten(1)
        parts = [shares, means[:, : sum(bands[:2])]]
        return torch.cat((*parts, moments.variance.sqrt()) if self.slow else parts, dim=1).T


def transform_length(samples: float) -> int:
    """Return the next number of samples with a fast transform; longer ones can be halved."""
    even = 2 ** max(0, math.ceil(math.log2(max(1, samples) / LONGEST_ODD)))
    length: int = even * scipy.fft.next_fast_len(max(2, round(samples / even)))
    return length


def third(per_octave: int) -> int:
    """Return how many bands are a third of an octave, at least one."""
    return max(1, per_octave // 3)


def count_bands(length: int, per_octave: int) -> int:
    """Return how many bands there are from one period of a window up to half the rate."""
    return int(per_octave * math.log2(length / 2) + 1e-6)


def joined(power: Tensor) -> Tensor:
    """Return power (axes, ...) of all axes together (1, ...)."""
    return power if len(power) == 1 else power.sum(dim=0, keepdim=True)


def compared(bands: Tensor, mean: Tensor, gap: int, kinds: int) -> Tensor:
    """Return log bands (axes, frames, bands) in three or four comparisons: (frames, channels).

    With the ``mean`` (axes, frames, 1) of the frame, with the band ``gap`` below, with the same
    band one window earlier (the first frames with the first), and as they are; of each all axes.
    """
    bands, mean = bands.transpose(0, 1), mean.transpose(0, 1)
    earlier = (torch.arange(bands.shape[0], device=bands.device) - OVERLAP).clamp_min(0)
    relative, steps = bands - mean, bands[..., gap:] - bands[..., :-gap]
    comparisons = (relative, steps, bands - bands.index_select(0, earlier), bands)[:kinds]
    return torch.cat([part.flatten(1) for part in comparisons], dim=1)


def octave_filters(sampling_rate: float, samples: int, per_octave: int) -> Tensor:
    """Return triangles, even in the logarithm of frequency, that average the power of each band.

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
    steps = torch.arange(count_bands(samples, per_octave), dtype=torch.float64)
    centres, step = sampling_rate / samples * 2 ** (steps / per_octave), 2 ** (1 / per_octave)
    below, above = centres / step, centres * step
    return mean_filters(sampling_rate, samples, below, centres, above, constant=False)


def _ordered(rows: Tensor) -> Tensor:
    """Return each row in order of size; on a processor NumPy is three times as fast."""
    if is_at_hand(rows):
        return torch.from_numpy(np.sort(rows.numpy(), axis=1))
    return rows.sort(dim=1).values


def _reach(filters: Tensor) -> slice:
    """Return the range of frequencies that some of the filters (bands, frequencies) take."""
    taken = filters.any(dim=0).nonzero()
    return slice(int(taken[0]), int(taken[-1]) + 1) if len(taken) else slice(0)
