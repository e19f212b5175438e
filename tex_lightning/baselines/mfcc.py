"""Mel-frequency cepstral coefficients of a trace, and a bank whose filters narrow upwards."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.fft import dct
from scipy.signal import get_window

from tex_lightning.errors import UserError

Array = npt.NDArray[Any]

SPACINGS = ("mel", "decreasing")
MAX_SECONDS, MAX_OVERLAP, MAX_FILTERS = 1, 20, 1000  # far beyond any use, little memory
ZERO_PADDING = 4  # so that the narrowest filters meet several bins
FLOOR = 1e-10  # of the mean energy; digital silence would be minus infinity


@dataclass
class Cepstra:
    """How frames become coefficients: Hamming window, power spectrum, filters, logarithm, DCT-II.

    There is neither pre-emphasis nor liftering, and frames that would pass the end are left out.

    Attributes:
        window_seconds: Length of a frame.
        hop_seconds: From the start of a frame to that of the next.
        highest_hz: Upper end of the last filter; the first begins at 0 Hz.
        filters: How many.
        spacing: Spacing of the filters, mel or decreasing; see :func:`filter_edges`.
        first: First coefficient kept, counted from 1, which is the level.
        last: Last coefficient kept.
    """

    window_seconds: float
    hop_seconds: float
    highest_hz: float
    filters: int
    spacing: str
    first: int
    last: int

    def check(self) -> None:
        """Refuse settings that give no coefficients.

        Raises:
            UserError: Naming the settings and what they may be.
        """
        if self.spacing not in SPACINGS:
            raise UserError(f"model.baseline.spacing={self.spacing}: use {' or '.join(SPACINGS)}.")
        if min(self.window_seconds, self.hop_seconds, self.highest_hz) <= 0:
            raise UserError(
                "model.baseline: window_seconds, hop_seconds, highest_hz must exceed 0."
            )
        if not self.window_seconds <= min(MAX_SECONDS, MAX_OVERLAP * self.hop_seconds):
            raise UserError(
                f"model.baseline.window_seconds={self.window_seconds:g} takes up too much memory: "
                f"give at most {MAX_SECONDS} s and {MAX_OVERLAP} times hop_seconds."
            )
        if self.filters > MAX_FILTERS or self.hop_seconds > MAX_SECONDS:
            raise UserError(
                f"model.baseline: give at most {MAX_FILTERS} filters and hops of {MAX_SECONDS} s."
            )
        if not 1 <= self.first <= self.last <= self.filters:
            raise UserError(
                f"model.baseline: coefficients {self.first} to {self.last} are not among 1 to "
                f"{self.filters}; make 1 <= first <= last <= filters."
            )

    def coefficients(self, trace: Array, sampling_rate: float) -> Array:
        """Coefficients (frames, last - first + 1) float64 of a trace (samples,).

        A trace shorter than a frame is padded with zeros to one.

        Raises:
            UserError: If the filters reach beyond half the sampling rate.
        """
        if self.highest_hz > sampling_rate / 2:
            raise UserError(
                f"model.baseline.highest_hz={self.highest_hz:g} exceeds half the sampling rate, "
                f"{sampling_rate / 2:g} Hz; lower it."
            )
        length = max(1, round(self.window_seconds * sampling_rate))
        hop = max(1, round(self.hop_seconds * sampling_rate))
        padded = np.pad(trace, (0, max(0, length - len(trace)))).astype(np.float64)
        frames = np.lib.stride_tricks.sliding_window_view(padded, length)[::hop]
        size = ZERO_PADDING * length
        spectrum = np.fft.rfft(frames * get_window("hamming", length), size)
        energies = np.abs(spectrum) ** 2 @ self.bank(size, sampling_rate).T
        floor = FLOOR * energies.mean() + np.finfo(np.float64).tiny
        cepstrum = dct(np.log(np.maximum(energies, floor)), type=2, norm="ortho", axis=1)
        kept: Array = cepstrum[:, self.first - 1 : self.last]
        return kept

    def bank(self, size: int, sampling_rate: float) -> Array:
        """Triangles (filters, size // 2 + 1) with peaks of 1 over a spectrum of ``size`` samples.

        Each rises from the peak of the filter below it and falls to that of the filter above.
        """
        edges = filter_edges(self.filters, self.highest_hz, self.spacing)
        frequencies = np.fft.rfftfreq(size, 1 / sampling_rate)
        rise = (frequencies - edges[:-2, None]) / np.diff(edges)[:-1, None]
        fall = (edges[2:, None] - frequencies) / np.diff(edges)[1:, None]
        triangles: Array = np.minimum(rise, fall).clip(0)
        return triangles


def filter_edges(filters: int, highest_hz: float, spacing: str) -> Array:
    """Edges and peaks (filters + 2,) in Hz, rising from 0 to ``highest_hz``.

    ``mel`` spaces them evenly in mel = 2595 log10(1 + f / 700), so that filters widen with
    frequency. ``decreasing`` is that bank mirrored, f to ``highest_hz`` - f: the widths are the
    same and narrow with frequency.
    """
    highest_mel = 2595 * np.log10(1 + highest_hz / 700)
    edges: Array = 700 * (10 ** (np.linspace(0, highest_mel, filters + 2) / 2595) - 1)
    return edges if spacing == "mel" else (highest_hz - edges)[::-1]
