"""Band proportions: how often each frequency band exceeds its usual share of the spectrum.

MiniRocket (Dempster et al. 2021) classifies time series by the proportion of positive values of
many convolutions. Here the convolutions are the bands of short-time spectra: a feature has a
frequency and a threshold, and the windows and their bands follow from the data's own rate.
"""

import math
import statistics
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, compress
from typing import Annotated, Any, ClassVar

import torch
from torch import Tensor, nn

from tex_lightning.errors import UserError
from tex_lightning.senses.features.array_gain import ArrayGain
from tex_lightning.senses.features.gravity import GravityGain
from tex_lightning.senses.features.moments import Moments
from tex_lightning.senses.features.movement import block_length, moving
from tex_lightning.senses.features.octave_bands import (
    MAX_BLOCK,
    OctaveBands,
    count_bands,
    third,
    transform_length,
)
from tex_lightning.senses.features.spectrogram import MAX_WINDOW

MIN_SAMPLES = 8  # of a window; at a slow rate the short ones are left out
# that fit the usual training recording at least, if levels do not count and if they do: fewer give
# no proportions, nor deviations
WINDOWS_IN_RECORDING, WINDOWS_IN_SLOW = 2, 4
MAX_WINDOWS = 16
MAX_HELD = 1 << 25  # samples of the training; what comes after them is read several times
MAX_RECORDINGS = 2000  # that level and thresholds are learnt from, evenly spread over the training
MAX_FRAMES = 50_000  # frames, about, that thresholds are learnt from: enough for quantiles
QUIET = 1e-3  # of a channel's usual deviation
MAX_APART = 8  # axes of a slow signal whose bands also count one by one
LEVEL = "level"  # a kind of blocks


class BandProportions(nn.Module):
    """Proportions of time that bands are above thresholds, for each fragment of the movement.

    The bands of a frame are triangles even in the logarithm of frequency, from one period of the
    window up to half the rate. Axes are joined by adding their power. A band is compared with
    thresholds in three ways, each a block of features of the kind ``shape``: with the mean of its
    frame, with the band a third of an octave below, and with itself one window earlier, so that
    neither the strength of a stroke nor the sensor's gain matters. Frames lose their linear trend,
    since a tool in a hand tilts and gravity turns with it; but not where all channels are always
    positive, as of a pressure, whose trend is the stroke.

    Thresholds are quantiles over the training set, without labels. Beyond the outer ones a
    proportion is 0 or 1, so the means of the first two comparisons are features as well, of the
    kind ``mean``. Highest bands in which there is nothing, as of a lower rate, count as usual ones.

    A slow signal has few frames, and its direction and level often tell the class. Its further
    blocks are

    - ``power``: proportions of a band compared with the mean power of the training set;
    - ``deviation``: the deviations of all four comparisons;
    - ``axes`` and ``axes_power``: the same proportions of every axis by itself, of 2 to 8 axes;
    - ``level``: mean and logarithm of the deviation of each channel, in units of its usual
      deviation; where all training samples of a channel are positive, as of a pressure, the mean is
      a logarithm too, so that a gain becomes a constant.

    Where gravity tells that an accelerometer has another gain or unit, that is taken back
    (:class:`~tex_lightning.senses.features.gravity.GravityGain`), and so is another gain of an
    array of pressures (:class:`~tex_lightning.senses.features.array_gain.ArrayGain`).

    Args:
        sampling_rate: Rate of the signals in Hz.
        windows: Lengths of the Hann windows in seconds, rounded up to a number of samples with a
            fast transform; a short one resolves the order of events, a long one low bands. Those
            of fewer than eight samples at this rate, or more than 65,536, are left out, and so are
            those that are longer than half of the usual training recording, or a quarter where
            levels count, but for the shortest. A shorter recording is mirrored until they fit.
        fragment_seconds: Approximate length of a fragment; a movement is cut into equal ones.
        levels: Number of channels whose level counts; None or 0 for none.

    Raises:
        UserError: If no window at this rate has a band.

    Attributes:
        bands: Number of features of a fragment, D.
        blocks: Kind and number of features of each block, in their order.
        bins: Number of the frequency band of each feature, -1 where levels count.
        windows: The bands of each window.
        used: Those of the windows that fit, and of the shortest in any case.
    """

    title: ClassVar = "band proportions"  # of the model that weighs them
    windows: Any  # a list of modules knows no class
    used: list[OctaveBands]
    level: Tensor
    fits: Tensor
    positive: Tensor
    deviation: Tensor
    unit: Tensor
    detrends: Tensor

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
        self.windows = nn.ModuleList()
        for seconds, per_octave in zip(windows, bands_per_octave, strict=True):
            self._add_window(seconds, per_octave, thresholds)
        if not self.windows:
            raise UserError(
                f"No window of {MIN_SAMPLES} to {MAX_WINDOW} samples at {sampling_rate:g} Hz has "
                "a band; choose other features.windows."
            )
        self.blocks = [block for window in self.windows for block in window.blocks]
        self.blocks += [(LEVEL, self.levels)] * 2 if self.levels else []
        self.bands = sum(size for _, size in self.blocks)
        self.bins = [-1] * self.bands if self.levels else self._bins()
        self.register_buffer("level", torch.ones(()))
        self.register_buffer("fits", torch.zeros(len(self.windows), dtype=torch.bool))
        self.register_buffer("positive", torch.zeros(self.levels, dtype=torch.bool))
        self.register_buffer("deviation", torch.ones(self.levels))
        self.register_buffer("unit", torch.ones(self.levels))
        self.register_buffer("detrends", torch.zeros((), dtype=torch.bool))
        self.gravity, self.array = GravityGain(self.levels), ArrayGain(self.levels)
        self._note_learnt()
        loaded: Any = self.register_load_state_dict_post_hook  # it has no annotations
        loaded(BandProportions._note_learnt)

    def _add_window(self, seconds: float, per_octave: int, thresholds: int) -> None:
        """Add the bands of a window, if it has enough samples; long ones take too much memory."""
        length = transform_length(min(seconds * self.sampling_rate, 1e9))
        has_bands = count_bands(length, per_octave) > third(per_octave)
        if not MIN_SAMPLES <= length <= MAX_WINDOW or not has_bands:
            return
        part = OctaveBands(
            self.sampling_rate, length, per_octave,
            thresholds=thresholds, slow=self.levels > 0, apart=self.apart,
        )  # fmt: skip
        self.windows.append(part)

    def _bins(self) -> list[int]:
        bins: list[int] = []
        for window in self.windows:
            first = max(bins, default=-1) + 1
            bins += [first + band for band in window.bins]
        return bins

    def _note_learnt(self, *_: object) -> None:
        """Note the windows that are used, and what they do, also after weights were loaded."""
        shortest = min(self.windows, key=lambda window: window.length)
        fits = zip(self.windows, self.fits.tolist(), strict=True)
        # numbers too, since torch.export puts others in the place of the modules
        self.fitting = [fit or window is shortest for window, fit in fits]
        self.used = [*compress(self.windows, self.fitting)]
        for window in self.used:
            window.detrends = bool(self.detrends)

    @property
    def longest(self) -> OctaveBands:
        """The longest window in use, which has the fewest frames."""
        return max(self.used, key=lambda window: window.length)

    @property
    def min_samples(self) -> int:
        """Samples of movement that a recording has to have; it is mirrored where no window fits."""
        block = block_length(self.sampling_rate)
        return block if self.skip_impact else min(block, *(x.length for x in self.windows))

    def movement(self, trace: Tensor) -> Tensor:
        """Return the movement (axes, samples) in a trace, at the usual gain.

        Raises:
            UserError: If it is shorter than 0.05 s, or 8 samples.
        """
        trace = self.gravity(trace)
        if self.skip_impact:
            trace = moving(trace, self.sampling_rate)
        self.check_length(trace)
        trace = self.array(trace)
        return trace

    def gain(self, trace: Tensor) -> Tensor | float:
        """Return by what each channel of a trace (axes, samples) is multiplied, (axes, 1) or ()."""
        gravity = self.gravity.gain(trace)
        if self.array.in_use and self.skip_impact:
            trace = moving(trace, self.sampling_rate)
        return gravity * self.array.gain(trace)

    def check_length(self, trace: Tensor) -> None:
        """Reject a movement (axes, samples) likewise."""
        if trace.shape[-1] < self.min_samples:
            raise UserError(
                f"The signal has {trace.shape[-1] / self.sampling_rate:.2g} s of movement, less "
                f"than {self.min_samples / self.sampling_rate:.2g} s; record a longer stroke."
            )

    def filled(self, movement: Tensor) -> Tensor:
        """Return a movement (axes, samples), mirrored until the longest window fits it."""
        have, take = movement.shape[-1], self.longest.length
        if not torch.compiler.is_exporting() and have >= take:
            return movement
        most: Any = torch.sym_max(have, take)  # type: ignore[no-untyped-call]
        places = torch.arange(most, device=movement.device)
        # a tensor, since ONNX's remainder takes no number that is known only at run time
        places = torch.remainder(places, torch.full_like(places, 2 * have))
        return movement[:, torch.minimum(places, 2 * have - 1 - places)]

    def learn(self, traces: Sequence[Tensor]) -> None:
        """Take level, thresholds, and which windows fit, from at most 2,000 of the training set.

        Args:
            traces: (axes, samples) each; what is not held is read several times.
        """
        chosen = range(0, len(traces), math.ceil(len(traces) / MAX_RECORDINGS))
        for window in self.windows:
            window.usual.forget()
        self.gravity.take(None)
        self.array.take(None)
        held, samples = self._held(traces[number] for number in chosen)
        lengths = torch.tensor([window.length for window in self.windows])
        least = WINDOWS_IN_SLOW if self.levels else WINDOWS_IN_RECORDING
        self.fits.copy_(lengths * least <= statistics.median(samples))
        self._note_learnt()

        def movements() -> Iterator[Tensor]:
            others = (self.movement(traces[number]) for number in chosen[len(held) :])
            return (self.filled(movement) for movement in chain(held, others))

        powers = [movement.var(dim=-1, correction=0).sum() for movement in movements()]
        level = torch.stack(powers).mean()
        self.level.copy_(level if level > 0 else torch.ones_like(level))
        if self.levels:
            self._learn_levels(movements)
        self.detrends.fill_(not (self.levels and self.positive.all()))
        self._note_learnt()
        kept = MAX_FRAMES // len(samples)
        for window in self.used:
            window.learn(torch.cat([window.thinned(x, self.level, kept) for x in movements()]))

    def _held(self, traces: Iterable[Tensor]) -> tuple[list[Tensor], list[int]]:
        """Return the movement of the first traces, and the samples of that of all."""
        held, samples, size = [], [], 0
        for movement in map(self.movement, traces):
            samples.append(movement.shape[-1])
            size += movement.numel()
            if size <= MAX_HELD:
                held.append(movement)
        return held, samples

    def _load_from_state_dict(self, state: dict[str, Any], prefix: str, *rest: Any) -> None:  # noqa: ANN401
        """Load a state; older checkpoints number buffers, know no usual bands, units or trends."""
        for number, window in enumerate(self.windows):
            for name, value in window.named_buffers():
                new, old = f"{prefix}windows.{number}.{name}", f"{prefix}{name}{number}"
                if old in state:
                    state[new] = state.pop(old)
                elif name == "usual.moments":
                    usual = state.pop(f"{prefix}windows.{number}.usual", value.new_zeros(2, 1))
                    state.setdefault(new, window.usual.of_older(usual))
        state.setdefault(f"{prefix}detrends", torch.zeros((), dtype=torch.bool))
        state.setdefault(f"{prefix}unit", torch.ones(self.levels))
        super()._load_from_state_dict(state, prefix, *rest)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take the state of a pickle; older ones know no units and no gain of an array."""
        super().__setstate__(state)  # type: ignore[no-untyped-call]  # no annotation
        self._buffers.setdefault("unit", torch.ones(self.levels))
        self._modules.setdefault("array", ArrayGain(self.levels))

    def _learn_levels(self, movements: Callable[[], Iterator[Tensor]]) -> None:
        """Find which channels are positive, the usual deviation of each, and what tells gain."""
        measured = [
            ((x > 0).all(dim=-1), x.std(dim=-1, correction=0), x.mean(dim=-1)) for x in movements()
        ]
        positive, deviations, means = map(torch.stack, zip(*measured, strict=True))
        self.positive.copy_(positive.all(dim=0))
        deviation = deviations.mean(dim=0)
        self.deviation.copy_(torch.where(deviation > 0, deviation, torch.ones_like(deviation)))
        self.unit.copy_(self.deviation)  # else what hardly varies would depend on that of the file
        self.gravity.fit(means, self.positive)
        self.array.fit(means, self.positive)

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
        fewest = self.longest.count_frames(movement.shape[-1])
        fragments = min(fewest, self.count_fragments(samples))
        summaries = [
            window.summary(
                window.in_blocks(movement, self.level),
                window.count_frames(movement.shape[-1]),
                fragments,
            )
            for window in self.used
        ]
        return self.join(summaries, movement, fragments)

    def count_fragments(self, samples: int) -> int:
        """Return how many fragments so many samples of movement are to have, at least one."""
        return max(1, round(samples / self.sampling_rate / self.fragment_seconds))

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
        of_used = iter(summaries)
        parts = [
            next(of_used) if used else movement.new_zeros(window.width, fragments)
            for window, used in zip(self.windows, self.fitting, strict=True)
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
        mean = moments.means[0].T
        away = mean - whole
        square = moments.variance.T + away.square()
        tiny = torch.finfo(mean.dtype).tiny
        level = torch.where(
            self.positive[:, None], mean.clamp_min(tiny).log(), mean / self.unit[:, None]
        )
        return torch.cat((level, (square.sqrt() / self.deviation[:, None] + QUIET).log()))
