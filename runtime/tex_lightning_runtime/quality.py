"""Faults of recordings that can be read: nothing measured, clipped, unlike the training.

A sensor that is off and an input in another unit are classified like any other, and often with
certainty. So a network comes with the ranges of its training recordings, and every prediction says
what its input lacks.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from tex_lightning_runtime.samples import Array

Ranges = Mapping[str, list[float]]  # smallest and largest value in training, by measure
# by measure the smallest and largest usual value, and what is said of others
Limits = Mapping[str, tuple[float, float, str]]

# of each measure how many times beyond that range is usual, and what to do about others
MEASURES = {
    "constant": (1.0, "check the sensor"),  # axes
    "clipped": (3.0, "lower the sensor's gain"),  # share of the samples
    "level": (3.0, "check the sensor, its unit and gain"),
    "rate": (1.5, "check the rate that was given, or record as for the training"),
    "brightness": (3.0, "check lens and light"),
    "contrast": (3.0, "check lens and light"),
}
FLAT_SHARE = 0.01  # of the samples, from which on a trace counts as clipped
MIN_FLAT = 10  # samples; a few at the extremes of a slow trace are none
FEW = 256  # samples in which different values are looked for first; a quiet beginning has few
FINE_VALUES = 32  # a coarsely digitised trace often stays at its extremes without being clipped
SAME = 2e-6  # of a constant, by which resampling may change it
UNLIKE = 0.5  # of votes and probabilities that is spread where an input is unlike the training
UNIFORM = 0.5  # standard deviation in grey levels of 255, below which a photo shows nothing
PHOTO_SIDE = 256  # pixels of a photo that are looked at, along each side


class Quality(NamedTuple):
    """Faults of an input, a sentence each, and whether nothing at all was measured."""

    warnings: tuple[str, ...] = ()
    empty: bool = False

    @property
    def doubt(self) -> float:
        """Share of votes and probabilities that a prediction spreads evenly over all classes."""
        return 1.0 if self.empty else UNLIKE if self.warnings else 0.0


def level(samples: Array) -> float:
    """Return the root mean square of all axes (axes, samples) together, each without its mean."""
    return float(np.sqrt(samples.var(axis=1, dtype=np.float64).sum()))


def trace_quality(
    samples: Array, usual: Limits, what: str, measures: Mapping[str, float]
) -> Quality:
    """Return the faults of a signal.

    Args:
        samples: (axes, samples) as they came: resampling would blur what is constant or clipped.
        usual: Usual values (:func:`limits`); what they lack is not compared.
        what: Name of the signal in messages.
        measures: ``level`` and ``rate`` (:func:`trace_measures`) that are compared with them.
    """
    survey = Survey()
    survey.add(samples)
    return survey.quality(usual, what, measures)


class Survey:
    """What tells the faults of a signal that goes on, whose samples are not kept."""

    def __init__(self) -> None:
        self.samples = 0
        self.axes: list[Axis] = []

    def add(self, samples: Array) -> None:
        """Look at the next samples (axes, samples), at least one."""
        self.axes = self.axes or [Axis() for _ in samples]
        self.samples += samples.shape[1]
        for axis, values in zip(self.axes, samples, strict=True):
            axis.add(values)

    def quality(self, usual: Limits, what: str, measures: Mapping[str, float]) -> Quality:
        """Return the faults so far; arguments are those of :func:`trace_quality`."""
        if all(axis.constant for axis in self.axes):
            how = "constant" if any(axis.high for axis in self.axes) else "silent"
            warning = f"The {what} is {how}, so nothing was measured; check the sensor."
            return Quality((warning,), empty=True)
        warnings, found = [], self.measures
        if found["constant"] > _most("constant", usual):
            warnings = [
                f"Axis {number} of the {what} is constant; {MEASURES['constant'][1]}."
                for number, axis in enumerate(self.axes, 1)
                if axis.constant
            ]
        if found["clipped"] >= FLAT_SHARE and found["clipped"] > _most("clipped", usual):
            warnings.append(
                f"The {what} is clipped, {found['clipped']:.0%} of it at its largest or smallest "
                f"value; {MEASURES['clipped'][1]}."
            )
        return Quality((*warnings, *_unlike(usual, what, measures)))

    @property
    def measures(self) -> dict[str, float]:
        """Number of constant axes, and the largest share of an axis at its extremes, so far."""
        flat = max((axis.flat for axis in self.axes if not axis.constant), default=0)
        constant = sum(axis.constant for axis in self.axes)
        return {"constant": float(constant), "clipped": flat / self.samples}


def _most(measure: str, usual: Limits) -> float:
    """Return the largest usual value of a fault; 0 where the training is not known."""
    return usual[measure][1] if measure in usual else 0.0


class Axis:
    """One axis of a :class:`Survey`.

    Attributes:
        low: Smallest value.
        high: Largest value.
    """

    def __init__(self) -> None:
        self.low, self.high = np.inf, -np.inf
        self.at_low = self.at_high = 0  # repetitions
        self.last = self.different = np.zeros(0)

    def add(self, values: Array) -> None:
        """Look at the next values (samples,)."""
        low, high = values.min(), values.max()
        if low < self.low:
            self.low, self.at_low = low, 0
        if high > self.high:
            self.high, self.at_high = high, 0
        joined = np.concatenate((self.last, values))
        self.at_low += _repetitions(joined == self.low)
        self.at_high += _repetitions(joined == self.high)
        self.last = values[-1:]
        start, count = 0, FEW
        while len(self.different) < FINE_VALUES and start < len(values):  # sorting is slow
            part = values[start : start + count]
            self.different = np.unique(np.concatenate((self.different, part)))[:FINE_VALUES]
            start, count = start + count, 2 * count

    @property
    def constant(self) -> bool:
        """Whether all values are the same, but for rounding."""
        return bool(self.high - self.low <= SAME * abs(self.high))

    @property
    def flat(self) -> int:
        """Repetitions of the extremes; 0 for few, or for a coarse digitisation."""
        flat = self.at_low + self.at_high
        return 0 if flat < MIN_FLAT or len(self.different) < FINE_VALUES else flat


def _repetitions(there: Array) -> int:
    """Count the true values (samples,) that come after another one."""
    return int(np.count_nonzero(there[1:] & there[:-1]))


class Level:
    """The :func:`level` of a signal that goes on (Chan, Golub and LeVeque 1983)."""

    def __init__(self) -> None:
        self.samples: int = 0
        self.mean: Any = 0.0
        self.squares: Any = 0.0  # of deviations, (axes,)

    def plus(self, samples: Array) -> "Level":
        """Return that with the next samples (axes, samples)."""
        total, more = Level(), samples.shape[1]
        if not more:
            return self
        total.samples = self.samples + more
        away = samples.mean(axis=1, dtype=np.float64) - self.mean
        total.mean = self.mean + away * more / total.samples
        between = away**2 * self.samples * more / total.samples
        within = samples.var(axis=1, dtype=np.float64) * more
        total.squares = self.squares + within + between
        return total

    @property
    def value(self) -> float:
        """The level so far, of at least one sample."""
        return float(np.sqrt(np.sum(self.squares) / self.samples))


def trace_measures(level: float, rate: float, sampling_rate: float) -> dict[str, float]:
    """Return what is compared of a signal.

    Args:
        level: That of the decoded signal (:func:`level`).
        rate: Rate of the recording in Hz.
        sampling_rate: Rate in Hz to which it was resampled: a higher rate adds nothing.
    """
    return {"level": level, "rate": min(rate, sampling_rate)}


def photo_quality(photo: Array, usual: Limits, what: str) -> Quality:
    """Return the faults of a decoded photo (height, width, 3) that is called ``what``.

    What the :func:`limits` in ``usual`` lack is not compared.
    """
    measures = photo_measures(photo)
    if measures["contrast"] < UNIFORM:
        return Quality((f"The {what} is uniform, so it shows nothing; check the camera.",), True)
    return Quality(tuple(_unlike(usual, what, measures)))


def together(qualities: Iterable[Quality]) -> Quality:
    """Join the faults of all inputs of one sample."""
    inputs = list(qualities)
    warnings = tuple(chain.from_iterable(quality.warnings for quality in inputs))
    return Quality(warnings, all(quality.empty for quality in inputs))


def photo_measures(photo: Array) -> dict[str, float]:
    """Return mean and standard deviation of the grey levels, 0 to 255, of some of the pixels."""
    step = max(1, min(photo.shape[:2]) // PHOTO_SIDE)
    red, green, blue = np.moveaxis(photo[::step, ::step], 2, 0)
    grey = red.astype(np.uint16) + green + blue  # a mean over the last axis takes six times as long
    return {"brightness": float(grey.mean()) / 3, "contrast": float(grey.std()) / 3}


def limits(ranges: Ranges) -> Limits:
    """Return the smallest and largest usual value of each measure, and the warning for others."""
    usual = {}
    for name, (low, high) in ranges.items():
        factor, remedy = MEASURES[name]
        advice = f"and the training had {low:.5g} to {high:.5g}; {remedy}."
        usual[name] = (low / factor, high * factor, advice)
    return usual


def _unlike(usual: Limits, what: str, measures: Mapping[str, float]) -> Iterator[str]:
    """Return a warning for each measure that is far from the usual."""
    for name, value in measures.items():
        low, high, advice = usual.get(name, (0.0, np.inf, ""))
        if not low <= value <= high:
            yield f"The {what} has a {name} of {value:.5g} {advice}"
