"""Faults of recordings that can be read: nothing measured, clipped, unlike the training.

A sensor that is off and an input in another unit are classified like any other, and often with
certainty. So the card of a checkpoint keeps the ranges of its training recordings
(:func:`training_ranges`), and every prediction says what its input lacks.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tex_lightning.data.decode import Photo, SignalDecoder, Trace
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store

Array = npt.NDArray[Any]
Ranges = Mapping[str, list[float]]  # smallest and largest value in training, by measure

QUANTILES = (0.01, 0.99)  # of the training recordings, so that a few odd ones do not count
# of each measure how many times beyond that range is usual, and what to do about others
MEASURES = {
    "level": (3.0, "check the sensor, its unit and gain"),
    "rate": (1.5, "check the rate that was given, or record as for the training"),
    "brightness": (3.0, "check lens and light"),
    "contrast": (3.0, "check lens and light"),
}
FLAT_SHARE = 0.01  # of the samples, from which on a trace counts as clipped
MIN_FLAT = 10  # samples; a few at the extremes of a slow trace are none
FINE_VALUES = 32  # a coarsely digitised trace often stays at its extremes without being clipped
UNIFORM = 0.5  # standard deviation in grey levels of 255, below which a photo shows nothing
PHOTO_SIDE = 256  # pixels of a photo that are looked at, along each side


class Quality(NamedTuple):
    """Faults of an input, a sentence each, and whether nothing at all was measured."""

    warnings: tuple[str, ...] = ()
    empty: bool = False


def level(samples: Array) -> float:
    """Return the root mean square of all axes (axes, samples) together, each without its mean."""
    return float(np.sqrt(samples.var(axis=1, dtype=np.float64).sum()))


class TraceMonitor:
    """Level, constancy and clipping of a signal that may come in pieces.

    Args:
        what: What it is called.
    """

    def __init__(self, what: str) -> None:
        self.what = what
        self.count = 0

    def update(self, samples: Array) -> None:
        """Take the next samples (axes, samples), at least one."""
        x = samples.astype(np.float64)
        low, high = x.min(axis=1), x.max(axis=1)
        if not self.count:
            self.offset, self.low, self.high = x[:, 0].copy(), low, high
            self.sum, self.squares, self.flat = np.zeros((3, len(x)))
        wider = (low < self.low) | (high > self.high)
        self.low, self.high = np.minimum(self.low, low), np.maximum(self.high, high)
        self.flat = np.where(wider, 0, self.flat) + self._count_flat(x)
        centred = x - self.offset[:, None]  # else gravity would cost digits
        self.sum += centred.sum(axis=1)
        self.squares += np.square(centred).sum(axis=1)
        self.count += x.shape[1]

    def _count_flat(self, x: Array) -> Array:
        """Count the samples of each axis that repeat its largest or smallest value so far."""
        extreme = (x == self.low[:, None]) | (x == self.high[:, None])
        flat: Array = (extreme[:, 1:] & (x[:, 1:] == x[:, :-1])).sum(axis=1)
        for axis in np.flatnonzero(flat):
            if len(np.unique(x[axis])) < FINE_VALUES:
                flat[axis] = 0
        return flat

    @property
    def level(self) -> float:
        """As :func:`level` of all samples so far."""
        variances = self.squares / self.count - np.square(self.sum / self.count)
        return float(np.sqrt(np.maximum(variances, 0).sum()))

    def quality(self, ranges: Ranges, **measures: float) -> Quality:
        """Name the faults of the trace so far.

        Args:
            ranges: Ranges of the training; what they lack is not compared.
            **measures: ``level`` and ``rate`` (:func:`trace_measures`) that are compared with them.
        """
        constant = self.low == self.high
        if constant.all():
            how = "silent" if not self.high.any() else "constant"
            return Quality(
                (f"The {self.what} is {how}, so nothing was measured; check the sensor.",), True
            )
        warnings = [
            f"Axis {axis + 1} of the {self.what} is constant; check the sensor."
            for axis in np.flatnonzero(constant)
        ]
        flat = float(np.where(constant, 0, self.flat).max())
        clipped = flat / self.count
        if flat >= MIN_FLAT and clipped >= FLAT_SHARE:
            warnings.append(
                f"The {self.what} is clipped, {clipped:.0%} of it at its largest or smallest "
                "value; lower the sensor's gain."
            )
        return Quality((*warnings, *_unlike(ranges, self.what, measures)))


def trace_measures(trace: Trace, rate: float, sampling_rate: float) -> dict[str, float]:
    """Measure a signal.

    Args:
        trace: (axes, samples), decoded.
        rate: Rate of the recording in Hz.
        sampling_rate: Rate in Hz to which it was resampled: a higher rate adds nothing.
    """
    return {"level": level(trace), "rate": min(rate, sampling_rate)}


def photo_quality(photo: Photo, ranges: Ranges, what: str) -> Quality:
    """Say what is wrong with a decoded photo (height, width, 3) that is called ``what``."""
    measures = _photo_measures(photo)
    if measures["contrast"] < UNIFORM:
        return Quality((f"The {what} is uniform, so it shows nothing; check the camera.",), True)
    return Quality(tuple(_unlike(ranges, what, measures)))


def together(qualities: Iterable[Quality]) -> Quality:
    """Join the faults of all inputs of one sample."""
    inputs = list(qualities)
    warnings = tuple(chain.from_iterable(quality.warnings for quality in inputs))
    return Quality(warnings, all(quality.empty for quality in inputs))


def training_ranges(rows: Iterable[Recording], store: Store) -> dict[str, list[float]]:
    """Measure training recordings of one modality: each measure's ends, by quantiles."""
    values: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        decoder, recording = store.decoders[row.modality], store.load(row)
        if isinstance(decoder, SignalDecoder):
            measures = trace_measures(recording, store.rate(row).hz, decoder.sampling_rate)
        else:
            measures = _photo_measures(recording)
        for name, value in measures.items():
            values[name].append(value)
    return {name: np.quantile(numbers, QUANTILES).tolist() for name, numbers in values.items()}


def _photo_measures(photo: Photo) -> dict[str, float]:
    """Mean and standard deviation of the grey levels, 0 to 255, of some of the pixels."""
    step = max(1, min(photo.shape[:2]) // PHOTO_SIDE)
    grey = photo[::step, ::step].mean(axis=2)
    return {"brightness": float(grey.mean()), "contrast": float(grey.std())}


def limits(ranges: Ranges) -> dict[str, tuple[float, float, str]]:
    """Smallest and largest usual value of each measure, and the warning for others."""
    usual = {}
    for name, (low, high) in ranges.items():
        factor, remedy = MEASURES[name]
        advice = f"and the training had {low:.5g} to {high:.5g}; {remedy}."
        usual[name] = (low / factor, high * factor, advice)
    return usual


def _unlike(ranges: Ranges, what: str, measures: dict[str, float]) -> Iterator[str]:
    """Name the measures that lie far outside those of the training."""
    known = limits(ranges)
    for name, value in measures.items():
        low, high, advice = known.get(name, (0.0, np.inf, ""))
        if not low <= value <= high:
            yield f"The {what} has a {name} of {value:.5g} {advice}"
