"""Polyphase resampling, sample for sample what ``scipy.signal.resample_poly`` computes."""

from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from tex_lightning_runtime.errors import require

Array = npt.NDArray[Any]
REACH, BETA = 10, 5.0  # of SciPy's filter: samples of the lower rate on each side; Kaiser's window


class Resampler:
    """Bring signals (axes, samples) from the rate ``source`` to the rate ``target`` in Hz."""

    def __init__(self, source: float, target: float) -> None:
        ratio = Fraction(target / source if source > 0 else 0).limit_denominator(10_000)
        said = f"A sampling rate of {source:g} Hz is too far from {target:g} Hz; correct it."
        require(0.001 < ratio < 1000, said)
        self.up, self.down = ratio.numerator, ratio.denominator
        self.half = REACH * max(self.up, self.down) if ratio != 1 else 0  # of the filter

    def settled(self, samples: int) -> int:
        """How many samples of the new rate no sample after so many changes."""
        return max(0, -(-(samples * self.up - self.half) // self.down))

    def __call__(self, x: Array, first: int = 0) -> Array:
        """Samples float32 of the new rate, from ``first`` on, of all of ``x``."""
        up, down, count = self.up, self.down, -(-x.shape[1] * self.up // self.down)
        if up == down or first == count:
            return np.ascontiguousarray(x[:, first:][:, : count - first], np.float32)
        taps = _taps(up, self.half, x.dtype.str)
        # sample `up * row + p` is a sum over samples up to `down * row + newest[p]`
        newest, phases = np.divmod(np.arange(up) * down + self.half, up)
        lead, begin, rows = taps.shape[1] - 1, first // up, -(-count // up) - first // up
        length = (rows + (newest[-1] + lead) // down + 1) * down
        padded = np.pad(x, ((0, 0), (lead, length)))[:, begin * down :][:, :length]
        columns = padded.reshape(len(x), -1, down).swapaxes(1, 2).copy()
        every = sliding_window_view(columns, rows, axis=2)
        found = np.zeros((len(x), up, rows), x.dtype)
        for age in range(lead, -1, -1):  # SciPy's order, so that every sum is rounded as there
            late, residue = np.divmod(newest + lead - age, down)
            found += every[:, residue, late] * taps[phases, age, None]
        flat = found.swapaxes(1, 2).reshape(len(x), -1)
        return flat[:, first - begin * up : count - begin * up].astype(np.float32)


@cache
def _taps(up: int, half: int, kind: str) -> Array:
    """SciPy's low pass (phases, taps): a sinc under a Kaiser window, of gain ``up``."""
    cutoff, dtype = REACH / half, np.dtype(kind)
    sinc = cutoff * np.sinc(cutoff * np.arange(-half, half + 1.0))
    low_pass = sinc * np.kaiser(2 * half + 1, BETA)
    low_pass = (low_pass / low_pass.sum()).astype(dtype) * dtype.type(up)
    return np.pad(low_pass, (0, -len(low_pass) % up)).reshape(-1, up).T
