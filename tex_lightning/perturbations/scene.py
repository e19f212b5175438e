"""Further inputs of a perturbation besides the recording."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Scene:
    """The circumstances of one recording.

    Attributes:
        rng: Generator of everything random, seeded by the recording and the perturbation and not by
            the severity, so that a severer one adds to a milder one instead of being drawn anew.
        rate: Sampling rate of a signal in Hz; 0 for a photo.
        other: Gives a recording of the same modality and another class; for photos of any size.
    """

    rng: np.random.Generator
    rate: float
    other: Callable[[], Array]


def power(trace: Array) -> float:
    """Mean square of a trace (axes, samples) about the mean of each axis."""
    return float(np.var(trace, axis=1, dtype=np.float64).mean())


def scaled(disturbance: Array, trace: Array, snr: float) -> Array:
    """A disturbance brought to ``snr`` dB below the power of a trace; silence stays as it is."""
    own = power(disturbance)
    factor = np.sqrt(power(trace) / own / 10 ** (snr / 10)) if own > 0 else 0.0
    result: Array = disturbance * factor
    return result
