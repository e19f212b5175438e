"""Band proportions: how often each frequency band exceeds its usual share of the spectrum.

MiniRocket (Dempster et al. 2021) classifies time series by the proportion of positive values of
many convolutions. Here the convolutions are the bands of short-time spectra: a feature has a
frequency and a threshold, and the windows and their bands follow from the data's own rate.
"""

import math
import statistics
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, pairwise
from typing import Annotated, Any, ClassVar

import numpy as np
import scipy  # whose parts are loaded when they are used
import torch
from torch import Tensor, nn
from torch.nn.functional import embedding_bag

from tex_lightning.core.devices import is_at_hand
from tex_lightning.errors import UserError
from tex_lightning.senses.features.movement import block_length, moving
from tex_lightning.senses.features.spectrogram import MAX_WINDOW, mean_filters, triangles

OVERLAP = 4  # frames that every sample is in
LONGEST_ODD = 1024  # samples; transforms of more are fast if they can be halved
MIN_SAMPLES = 8  # of a window; at a slow rate the short ones are left out
# that fit the usual training recording at least, if levels do not count and if they do: fewer give
# no proportions, nor deviations
WINDOWS_IN_RECORDING, WINDOWS_IN_SLOW = 2, 4
MAX_WINDOWS = 16
RANGES = 8  # of bands, each of which is a product of its own: low bands take few channels
BLOCK = (
    1 << 18
)  # samples of the frames that are computed at once, about, so that they stay in cache
MIN_BLOCK, MAX_BLOCK = 64, 1024  # frames
MAX_HELD = 1 << 25  # samples of the training; what comes after them is read several times
MAX_RECORDINGS = 2000  # that level and thresholds are learnt from, evenly spread over the training
PARTS = 16  # fragments that rows are added to at once
MAX_FRAMES = 50_000  # frames, about, that thresholds are learnt from: enough for quantiles
FLOOR = 1e-7  # of the power of a frame; below it the logarithm is flat
SILENCE = 1e-15  # of the mean power of the training set, likewise
EMPTY, LEAST_DEPTH = 4.0, 2.0  # deviations, and nepers of power: a band that far below is empty
QUIET = 1e-3  # of a channel's usual deviation, likewise
MAX_APART = 8  # axes of a slow signal whose bands also count one by one
SHAPE, POWER = "shape", "power"  # kinds of blocks of proportions
AXES, AXES_POWER = "axes", "axes_power"  # the same of every axis by itself
MEAN, DEVIATION, LEVEL = "mean", "deviation", "level"


class BandProportions(nn.Module):
    """Proportions of time that bands are above thresholds, for each fragment of the movement.

    The bands of a frame are triangles even in the logarithm of frequency, from one period of the
    window up to half the rate. Axes are joined by adding their power. A band is compared with
    thresholds in three ways, each a block of features of the kind ``shape``: with the mean of its
    frame, with the band a third of an octave below, and with itself one window earlier, so that
    neither the strength of a stroke nor the sensor's gain matters.

    Thresholds are quantiles over the training set, without labels. Beyond the outer ones a
    proportion is 0 or 1, so the means of the first two comparisons are features as well, of the
    kind ``mean``. Highest bands in which there is nothing, as of a lower rate, count as usual ones.

    A slow signal has few frames, and its direction and level often tell the class. Its further
    blocks are

    - ``power``: proportions of a band compared with the mean power of the training set;
    - ``deviation``: the deviations of all four comparisons;
    - ``axes`` and ``axes_power``: the same proportions of every axis by itself, of 2 to 8 axes;
    - ``level``: mean and logarithm of the deviation of each channel; where all training samples of
      a channel are positive, as of a pressure, the mean is a logarithm too, so that a gain becomes
      a constant.

    Args:
        sampling_rate: Rate of the signals in Hz.
        windows: Lengths of the Hann windows in seconds, rounded up to a number of samples with a
            fast transform; a short one resolves the order of events, a long one low bands. Those
            of fewer than eight samples at this rate, or more than 65,536, are left out, and so are
            those that are longer than half of the usual training recording, or a quarter where
            levels count, but for the shortest. A shorter recording is mirrored until they fit.
        bands_per_octave: How finely frequency is divided, for each window.
        thresholds: Number of thresholds for each band.
        fragment_seconds: Approximate length of a fragment; a movement is cut into equal ones.
        skip_impact: Leave out the part before steady movement, and rests.
        levels: Number of channels whose level counts; None or 0 for none.

    Raises:
        UserError: If no window at this rate has a band.

    Attributes:
        bands: Number of features of a fragment, D.
        blocks: Kind and number of features of each block, in their order.
        bins: Number of the frequency band of each feature, -1 where levels count.
        used: Numbers of the windows in use: those that fit, and the shortest in any case.
        longest: Number of the longest of them, which has the fewest frames.
    """

    title: ClassVar = "band proportions"  # of the model that weighs them
    level: Tensor
    fits: Tensor
    positive: Tensor
    deviation: Tensor

    def __init__(
        self,
        *,
        sampling_rate: float,
        windows: Annotated[Sequence[float], "(0, 3600] s", "lengths of the windows, at most 16"],
        bands_per_octave: Annotated[
            Sequence[int], "[1, 48]", "how finely frequency is divided, for each window"
        ],
        thresholds: Annotated[int, "[1, 64]", "thresholds of each band"],
        fragment_seconds: Annotated[float, "(0, 3600] s", "approximate length of a fragment"],
        skip_impact: Annotated[bool, "leave out the first touch of the tool, and rests"],
        levels: Annotated[int | None, "[0, 64]", "channels whose level counts; null: none"] = None,
    ) -> None:
        super().__init__()
        if not 1 <= len(windows) <= MAX_WINDOWS:
            raise UserError(f"features.windows: give 1 to {MAX_WINDOWS}, not {len(windows)}.")
        if len(windows) != len(bands_per_octave):
            raise UserError(
                "features.bands_per_octave: give a number for each of features.windows."
            )
        self.sampling_rate, self.skip_impact = sampling_rate, skip_impact
        self.fragment_seconds, self.levels = fragment_seconds, levels or 0
        self.apart = self.levels if 1 < self.levels <= MAX_APART else 0
        self.kinds = (SHAPE, SHAPE, SHAPE, POWER)[: 4 if self.levels else 3]
        self.lengths: list[int] = []
        self.gaps: list[int] = []
        self.sizes: list[tuple[int, ...]] = []  # of the comparisons
        self.widths: list[int] = []  # in features
        self.ranges: list[list[tuple[slice, slice]]] = []  # of bands, and the channels they take
        self.blocks: list[tuple[str, int]] = []
        self.bins: list[int] = []
        for seconds, per_octave in zip(windows, bands_per_octave, strict=True):
            self._add_window(seconds, per_octave, thresholds)
        if not self.lengths:
            raise UserError(
                f"No window of {MIN_SAMPLES} to {MAX_WINDOW} samples at {sampling_rate:g} Hz has "
                "a band; choose other features.windows."
            )
        self.blocks += [(LEVEL, self.levels)] * 2 if self.levels else []
        self.bands = sum(size for _, size in self.blocks)
        self.bins = self.bins or [-1] * self.bands
        self.register_buffer("level", torch.ones(()))
        self.register_buffer("fits", torch.zeros(len(self.lengths), dtype=torch.bool))
        self.register_buffer("positive", torch.zeros(self.levels, dtype=torch.bool))
        self.register_buffer("deviation", torch.ones(self.levels))
        self._note_windows()
        loaded: Any = self.register_load_state_dict_post_hook  # it has no annotations
        loaded(BandProportions._note_windows)

    def _add_window(self, seconds: float, per_octave: int, thresholds: int) -> None:
        """Add buffers and blocks of one window, if it has enough samples."""
        exact = min(seconds * self.sampling_rate, 1e9)
        even = 2 ** max(0, math.ceil(math.log2(max(1, exact) / LONGEST_ODD)))
        length = even * scipy.fft.next_fast_len(max(2, round(exact / even)))
        gap = max(1, per_octave // 3)
        if not MIN_SAMPLES <= length <= MAX_WINDOW:  # a longer one takes up too much memory
            return
        filters = octave_filters(self.sampling_rate, length, per_octave)
        bands = len(filters)
        if bands <= gap:
            return
        index, window = len(self.lengths), torch.hann_window(length, periodic=False)
        self.register_buffer(f"window{index}", window, persistent=False)
        self.register_buffer(f"filters{index}", filters.T.contiguous(), persistent=False)
        self.register_buffer(f"usual{index}", torch.zeros(2, bands))
        sizes = (bands, bands - gap, bands, bands)[: len(self.kinds)]
        self.register_buffer(
            f"thresholds{index}", torch.zeros(thresholds, sum(sizes) * (1 + self.apart))
        )
        self.lengths.append(length)
        self.gaps.append(gap)
        edges = [bands * part // RANGES for part in range(RANGES + 1)]
        parts = [slice(*pair) for pair in pairwise(edges)]
        self.ranges.append([(part, _reach(filters[part])) for part in parts])
        before = sum(size for _, size in self.blocks)
        self.blocks += zip(self.kinds, (size * thresholds for size in sizes), strict=True)
        if self.apart:
            apart = zip((AXES, AXES, AXES, AXES_POWER), sizes, strict=True)
            self.blocks += [(kind, size * thresholds * self.apart) for kind, size in apart]
        self.blocks += [(MEAN, size) for size in sizes[:2]]
        self.blocks += [(DEVIATION, sum(sizes))] if self.levels else []
        if not self.levels:
            self._add_bins(sizes, gap, thresholds)
        self.sizes.append(sizes)
        self.widths.append(sum(size for _, size in self.blocks) - before)

    def _add_bins(self, sizes: tuple[int, ...], gap: int, thresholds: int) -> None:
        """Add the band of each feature of a window, where levels do not count."""
        first, bands = max(self.bins, default=-1) + 1, torch.arange(sizes[0])
        shapes = [part.repeat_interleave(thresholds) for part in (bands, bands[gap:], bands)]
        self.bins += (first + torch.cat((*shapes, bands, bands[gap:]))).tolist()

    def _note_windows(self, *_: object) -> None:
        """Note the windows that are used, also after weights were loaded."""
        shortest = self.lengths.index(min(self.lengths))
        fits = enumerate(self.fits.tolist())
        self.used = [number for number, fit in fits if fit or number == shortest]
        self.longest = max(self.used, key=self.lengths.__getitem__)
        usual = [self.get_buffer(f"usual{number}") for number in self.used]
        self.knows_usual = any(bool(x.any()) for x in usual)

    @property
    def min_samples(self) -> int:
        """Samples of movement that a recording has to have."""
        block = block_length(self.sampling_rate) if self.skip_impact else None
        return max(min(self.lengths), block or 0)

    def movement(self, trace: Tensor) -> Tensor:
        """Return the movement (axes, samples) in a trace.

        Raises:
            UserError: If it is shorter than the shortest window, or 0.05 s.
        """
        if self.skip_impact:
            trace = moving(trace, self.sampling_rate)
        self.check_length(trace)
        return trace

    def check_length(self, trace: Tensor) -> None:
        """Reject a movement (axes, samples) likewise."""
        if trace.shape[-1] < self.min_samples:
            raise UserError(
                f"The signal has {trace.shape[-1] / self.sampling_rate:.2g} s of movement, less "
                f"than the shortest window of {self.min_samples / self.sampling_rate:.2g} s; "
                "record a longer stroke."
            )

    def filled(self, movement: Tensor) -> Tensor:
        """Return a movement (axes, samples), mirrored until the longest window fits it."""
        have, take = movement.shape[-1], self.lengths[self.longest]
        if not torch.compiler.is_exporting() and have >= take:
            return movement
        most: Any = torch.sym_max(have, take)  # type: ignore[no-untyped-call]
        places = torch.arange(most, device=movement.device)
        # a tensor, since ONNX's remainder takes no number that is known only at run time
        places = torch.remainder(places, torch.full_like(places, 2 * have))
        return movement[:, torch.minimum(places, 2 * have - 1 - places)]

    def responses(
        self, movement: Tensor, index: int, first: int = 0, last: int | None = None
    ) -> Tensor:
        """Return what one window compares with thresholds: (frames, channels), block after block.

        Args:
            movement: (axes, samples).
            index: Number of the window.
            first: First frame.
            last: One past the last frame; None takes all.
        """
        length = self.lengths[index]
        window, filters = self.get_buffer(f"window{index}"), self.get_buffer(f"filters{index}")
        before = max(0, first - OVERLAP)  # frames that the first ones are compared with
        frames = movement.unfold(-1, length, hop_length(length))[:, before:last]
        frames = (frames - frames.mean(dim=-1, keepdim=True)).mul_(window)
        squares = torch.view_as_real(torch.fft.rfft(frames)).square_()
        power = squares[..., 0] + squares[..., 1]
        power = power if self.apart else joined(power)
        sums = [
            power[..., channels] @ filters[channels, bands]
            for bands, channels in self.ranges[index]
        ]
        power = torch.cat(sums, dim=-1).div_(window.sum().square())
        return self.compare(power, index)[first - before :]

    def count_frames(self, samples: int, index: int) -> int:
        """Return how many frames of a window so many samples have."""
        length = self.lengths[index]
        return (samples - length) // hop_length(length) + 1

    def in_blocks(self, movement: Tensor, index: int, begin: int = 0) -> Iterator[Tensor]:
        """Yield the same as :meth:`responses` some frames (block, channels) at a time.

        Memory then does not grow with the movement (axes, samples). ``begin`` is the first frame.
        """
        frames = self.count_frames(movement.shape[-1], index)
        size = BLOCK // (len(movement) * self.lengths[index])
        size = min(max(size, MIN_BLOCK), MAX_BLOCK)
        for first in range(begin, frames, size):
            yield self.responses(movement, index, first, min(frames, first + size))

    def compare(self, power: Tensor, index: int) -> Tensor:
        """Compare the power of bands in four ways: of all axes together, and of each if they count.

        Args:
            power: (axes, frames, bands).
            index: Number of the window.
        """
        responses = []
        for part in (joined(power), power)[: 1 + bool(self.apart)]:
            # a floor of the frame's own power, so that gain leaves its shape
            floor = FLOOR * part.mean(dim=2, keepdim=True) + SILENCE * self.level
            logs = (part + floor).div_(self.level).log_()
            if self.knows_usual:
                logs = without_empty(logs, *self.get_buffer(f"usual{index}"))
            responses.append(compared(logs, self.gaps[index], len(self.kinds)))
        return responses[0] if len(responses) == 1 else torch.cat(responses, dim=1)

    def learn(self, traces: Sequence[Tensor]) -> None:
        """Take level, thresholds, and which windows fit, from at most 2,000 of the training set.

        Args:
            traces: (axes, samples) each; what is not held is read several times.
        """
        traces = traces[:: math.ceil(len(traces) / MAX_RECORDINGS)]
        self.fits.fill_(False)
        for index in range(len(self.lengths)):
            self.get_buffer(f"usual{index}").zero_()
        self._note_windows()
        counts: list[int] = []
        held: list[Tensor] = []
        size = 0
        for movement in map(self.movement, traces):
            counts.append(movement.shape[-1])
            size += movement.numel()
            if size <= MAX_HELD:
                held.append(movement)
        usual = statistics.median(counts)
        lengths = torch.tensor(self.lengths, device=self.fits.device)
        least = WINDOWS_IN_SLOW if self.levels else WINDOWS_IN_RECORDING
        self.fits.copy_(lengths * least <= usual)
        self._note_windows()

        def movements() -> Iterator[Tensor]:
            others = map(self.movement, traces[len(held) :])
            return (self.filled(movement) for movement in chain(held, others))

        powers = [movement.var(dim=-1, correction=0).sum() for movement in movements()]
        level = torch.stack(powers).mean()
        self.level.copy_(level if level > 0 else torch.ones_like(level))
        for index in self.used:
            kept = MAX_FRAMES // len(counts)
            responses = torch.cat([self._thinned(x, index, kept) for x in movements()])
            self._learn_thresholds(responses, self.get_buffer(f"thresholds{index}"))
            if not self.levels:  # slow sensors have silent bands, which tell the material
                relative = responses[:, : self.sizes[index][0]]
                depth = (EMPTY * relative.std(dim=0, correction=0)).clamp_min(LEAST_DEPTH)
                self.get_buffer(f"usual{index}").copy_(torch.stack([relative.mean(dim=0), depth]))
        if self.levels:
            self._learn_levels(movements)
        self._note_windows()

    def _thinned(self, movement: Tensor, index: int, kept: int) -> Tensor:
        """Return at most so many rows of responses at equal distances, and at least one."""
        frames = self.count_frames(movement.shape[-1], index)
        step, first, parts = math.ceil(frames / max(1, kept)), 0, []
        for responses in self.in_blocks(movement, index):
            parts.append(responses[-first % step :: step].clone())
            first += len(responses)
        return torch.cat(parts)

    def _learn_thresholds(self, responses: Tensor, thresholds: Tensor) -> None:
        """Set thresholds (thresholds, channels) to quantiles of responses (frames, channels)."""
        count, frames = len(thresholds), len(responses)
        shares = (torch.arange(count, dtype=torch.float64) + 0.5) / count
        places = (shares * frames).long().to(responses.device)
        after = (places + 1).clamp_max(frames - 1)  # between two: no rounding crosses it
        every = torch.arange(thresholds.shape[1], device=thresholds.device)
        size = max(1, BLOCK // frames)
        for channels in torch.split(every, size):
            ordered = _ordered(responses[:, channels].T)
            thresholds[:, channels] = ((ordered[:, places] + ordered[:, after]) / 2).T

    def _load_from_state_dict(self, state: dict[str, Any], prefix: str, *rest: Any) -> None:  # noqa: ANN401
        """Load a state; in checkpoints of before usual bands are not known."""
        for name, value in self.named_buffers():
            if name.startswith("usual"):
                state.setdefault(prefix + name, torch.zeros_like(value))
        super()._load_from_state_dict(state, prefix, *rest)

    def _learn_levels(self, movements: Callable[[], Iterator[Tensor]]) -> None:
        """Find the channels that are positive, and the usual deviation of each."""
        positive = [(movement > 0).all(dim=-1) for movement in movements()]
        self.positive.copy_(torch.stack(positive).all(dim=0))
        deviations = [movement.std(dim=-1, correction=0) for movement in movements()]
        deviation = torch.stack(deviations).mean(dim=0)
        self.deviation.copy_(torch.where(deviation > 0, deviation, torch.ones_like(deviation)))

    def forward(self, trace: Tensor) -> Tensor:
        """Map a trace (axes, samples) to features (1, 1, D, fragments).

        Raises:
            UserError: If it is too short, or does not have the channels whose level counts.
        """
        return self.describe(self.checked(trace))

    def checked(self, trace: Tensor) -> Tensor:
        """Return the movement in a trace that has features, which are not computed.

        Raises:
            UserError: As :meth:`forward`.
        """
        if self.levels and len(trace) != self.levels:
            raise UserError(
                f"The signal has {len(trace)} channels, and this network was trained on "
                f"{self.levels}; give a recording of the same sensor."
            )
        return self.movement(trace)

    def describe(self, movement: Tensor) -> Tensor:
        """Map a movement (axes, samples) that was cut out to the same features."""
        samples, movement = movement.shape[-1], self.filled(movement)
        frames = [self.count_frames(movement.shape[-1], index) for index in self.used]
        fewest = frames[self.used.index(self.longest)]
        fragments = min(fewest, self.count_fragments(samples))
        summaries = [
            self.summary(self.in_blocks(movement, index), index, count, fragments)
            for index, count in zip(self.used, frames, strict=True)
        ]
        return self.join(summaries, movement, fragments)

    def count_fragments(self, samples: int) -> int:
        """Return how many fragments so many samples of movement are to have, at least one."""
        return max(1, round(samples / self.sampling_rate / self.fragment_seconds))

    def summary(self, blocks: Iterable[Tensor], index: int, frames: int, fragments: int) -> Tensor:
        """Return the features (D, fragments) of one window.

        Args:
            blocks: Responses (block, channels), one block after the other.
            index: Number of the window.
            frames: Number of all frames.
            fragments: Number of equal fragments.
        """
        limits, bands = self.get_buffer(f"thresholds{index}"), self.sizes[index]
        above, means = Moments(frames, fragments), Moments(frames, fragments)
        for responses in blocks:  # as numbers: faster than a comparison as booleans
            found = responses.new_empty(responses.shape[0], *limits.shape)
            above.add(torch.gt(responses[:, None], limits, out=found).flatten(1))
            kept = responses[:, : sum(bands if self.levels else bands[:2])]
            means.add(kept, squares=self.levels > 0)
        shares = above.mean.reshape(-1, *limits.shape).transpose(1, 2).flatten(1)
        parts = [shares, means.mean[:, : sum(bands[:2])]]
        return torch.cat((*parts, means.variance.sqrt()) if self.levels else parts, dim=1).T

    def join(
        self,
        summaries: Iterable[Tensor],
        movement: Tensor,
        fragments: int,
        mean: Tensor | None = None,
    ) -> Tensor:
        """Return the features (1, 1, D, fragments) of all windows.

        Args:
            summaries: Features (D, fragments) of each window in use.
            movement: (axes, samples), for the levels.
            fragments: Number of equal fragments.
            mean: (axes, 1) of a longer movement that this is a part of; None takes its own.
        """
        by_window = dict(zip(self.used, summaries, strict=True))
        blank = movement.new_zeros
        parts = [
            by_window[index] if index in by_window else blank(self.widths[index], fragments)
            for index in range(len(self.lengths))
        ]
        if self.levels:
            mean = movement.mean(dim=-1, keepdim=True) if mean is None else mean
            parts.append(self._levels(movement, fragments, mean))
        return torch.cat([part.T for part in parts], dim=1).T[None, None]  # a fragment's together

    def _levels(self, movement: Tensor, fragments: int, whole: Tensor) -> Tensor:
        """Return mean and logarithm of the deviation of each channel (2 * levels, fragments).

        Deviations are from ``whole`` (axes, 1), the mean of the whole movement.
        """
        moments = Moments(movement.shape[-1], fragments)
        every = movement.T
        for block in (every,) if torch.compiler.is_exporting() else torch.split(every, MAX_BLOCK):
            moments.add(block, squares=True)
        mean = moments.mean.T
        away = mean - whole
        square = moments.variance.T + away.square()
        tiny = torch.finfo(mean.dtype).tiny
        level = torch.where(self.positive[:, None], mean.clamp_min(tiny).log(), mean)
        return torch.cat((level, (square.sqrt() / self.deviation[:, None] + QUIET).log()))


class Moments:
    """Mean and variance of rows over equal fragments of them, added block by block.

    Blocks are joined as Chan, Golub and LeVeque (1983) do, so that nothing large is subtracted.

    Args:
        rows: Number of all rows.
        fragments: Number of fragments, at most that of rows.

    Attributes:
        mean: (fragments, D) of the rows in each fragment.
    """

    mean: Tensor
    squares: Tensor
    counts: Tensor

    def __init__(self, rows: int, fragments: int) -> None:
        self.rows, self.fragments, self.before = rows, fragments, 0

    def add(self, block: Tensor, *, squares: bool = False) -> None:
        """Add the next rows (block, D), and their squared deviations if ``squares``."""
        if torch.compiler.is_exporting() or is_at_hand(block) or block.shape[0] == self.rows:
            self._add(block, squares)
            return
        size = max(1, PARTS * self.rows // self.fragments)
        for some in torch.split(block, size):  # with many fragments most products are 0
            self._add(some, squares)

    def _add(self, block: Tensor, squares: bool) -> None:
        rows, fragments, first = self.rows, self.fragments, self.before
        self.before += block.shape[0]
        whole = first == 0 and self.before == rows
        start = 0 if whole else first * fragments // rows
        stop = fragments if whole else (self.before - 1) * fragments // rows + 1
        every = torch.arange(start, stop + 1, device=block.device)
        bounds = ((every * rows + fragments - 1) // fragments - first).clamp_(0, block.shape[0])
        counts = bounds.diff()[:, None].to(block.dtype)
        mean, around = sums_between(bounds, block) / counts, None
        if squares:
            place = torch.arange(first, self.before, device=block.device) * fragments // rows
            around = sums_between(bounds, (block - mean[place - start]).square_())
        if whole:
            self.mean, self.counts = mean, counts
            self.squares = mean if around is None else around
        else:
            self._join(slice(start, stop), counts, mean, around)

    def _join(self, part: slice, counts: Tensor, mean: Tensor, squares: Tensor | None) -> None:
        """Join counts (parts, 1), means and squares (parts, D) with those before."""
        if part.start == 0 and not hasattr(self, "mean"):
            self.mean = mean.new_zeros(self.fragments, mean.shape[-1])
            self.squares = torch.zeros_like(self.mean) if squares is not None else self.mean
            self.counts = mean.new_zeros(self.fragments, 1)
        before, away = self.counts[part].clone(), mean - self.mean[part]
        self.counts[part] += counts
        share = counts / self.counts[part]
        self.mean[part] += away * share
        if squares is not None:
            self.squares[part] += squares + away.square() * (before * share)

    @property
    def variance(self) -> Tensor:
        """Variance (fragments, D) in each fragment, of rows that were added with squares."""
        return self.squares / self.counts


def sums_between(bounds: Tensor, rows: Tensor) -> Tensor:
    """Return the sums (segments, D) of rows (n, D) from each of the bounds to the next one."""
    places = torch.arange(rows.shape[0], device=rows.device)
    if is_at_hand(rows):  # a product, most of whose factors are 0, takes five times as long
        return embedding_bag(places, rows.contiguous(), bounds[:-1], mode="sum")
    member = (places >= bounds[:-1, None]) & (places < bounds[1:, None])
    return member.to(rows.dtype) @ rows


def hop_length(length: int) -> int:
    """Return the samples between the starts of frames of so many samples."""
    return max(1, round(length / OVERLAP))


def joined(power: Tensor) -> Tensor:
    """Return power (axes, ...) of all axes together (1, ...)."""
    return power if len(power) == 1 else power.sum(dim=0, keepdim=True)


def without_empty(logs: Tensor, usual: Tensor, depth: Tensor) -> Tensor:
    """Return log bands (axes, frames, bands) with empty ones as they usually are beside the others.

    What was recorded at a lower rate has nothing in the highest bands. They would change the mean
    of the frame, and with it all others.

    Args:
        logs: (axes, frames, bands).
        usual: The bands of a frame in training, relative to its mean, (bands,).
        depth: How far below a band is empty if those above are, (bands,).
    """
    mean = logs.mean(dim=2, keepdim=True) - usual.mean()
    highest = logs[..., -1:] - usual[-1] - mean
    if is_at_hand(logs) and bool((highest > -depth[-1]).all()):
        return logs
    apart = logs - usual
    heard = apart - mean > -depth
    for _ in range(2):  # the mean of those that are heard is higher, and more are empty below it
        heard = heard.flip(2).cumsum(dim=2).flip(2) > 0
        count = heard.sum(dim=2, keepdim=True).clamp_min(1)
        mean = (apart * heard).sum(dim=2, keepdim=True) / count
        heard = apart - mean > -depth
    heard = heard.flip(2).cumsum(dim=2).flip(2) > 0
    return torch.where(heard, logs, usual + mean)


def compared(bands: Tensor, gap: int, kinds: int) -> Tensor:
    """Return log bands (axes, frames, bands) in three or all four comparisons, side by side.

    With the mean of the frame, with the band ``gap`` below, with the same band one window earlier
    (the first frames with the first), and as they are.

    Returns:
        (frames, channels); of each comparison all axes.
    """
    earlier = (torch.arange(bands.shape[1], device=bands.device) - OVERLAP).clamp_min(0)
    relative, steps = bands - bands.mean(dim=2, keepdim=True), bands[..., gap:] - bands[..., :-gap]
    comparisons = (relative, steps, bands - bands.index_select(1, earlier), bands)[:kinds]
    return torch.cat([part.transpose(0, 1).flatten(1) for part in comparisons], dim=1)


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


def _ordered(rows: Tensor) -> Tensor:
    """Return each row in order of size; on a processor NumPy is three times as fast."""
    if is_at_hand(rows):
        return torch.from_numpy(np.sort(rows.numpy(), axis=1))
    return rows.sort(dim=1).values


def _reach(filters: Tensor) -> slice:
    """Return the range of frequencies that some of the filters (bands, frequencies) take."""
    taken = filters.any(dim=0).nonzero()
    return slice(int(taken[0]), int(taken[-1]) + 1) if len(taken) else slice(0)
