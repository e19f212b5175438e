"""Two baselines on Mel-frequency cepstral coefficients of a trace.

- Frames and a mixture of Gaussians for each class, after the TUM haptic texture database (Strese
  et al., Haptics Symposium and HAVE 2014), whose numbers of coefficients and components are not
  public.
- Modified coefficients, averaged over the movement, and Gaussian naive Bayes, after Strese,
  Schuwerk and Steinbach (World Haptics 2015). What they call decreasing is not defined there; here
  it is a bank whose filters narrow upwards.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
import torch
from scipy.fft import dct
from scipy.signal import get_window
from sklearn.mixture import GaussianMixture
from sklearn.naive_bayes import GaussianNB
from torch import Tensor

from tex_lightning.baselines.base import Array, EstimatorBaseline
from tex_lightning.core.console import log_once
from tex_lightning.errors import UserError

log = logging.getLogger(__name__)

SECONDS, FILTERS, MAX_OVERLAP = "(0, 1] s", "[1, 1000]", 20  # far beyond any use, little memory
Spacing = Literal["mel", "decreasing"]
ZERO_PADDING = 4  # so that the narrowest filters meet several bins
FLOOR = 1e-10  # of the mean energy; digital silence would be minus infinity


@dataclass
class Cepstra:
    """Cepstral coefficients of frames: Hamming window, power spectrum, filters, logarithm, DCT-II.

    There is neither pre-emphasis nor liftering, and frames that would pass the end are left out.
    Filters begin at 0 Hz, and end at half the sampling rate where they would go beyond; how they
    are spaced :func:`filter_edges` says. The first coefficient, which need not be kept, is the
    level.

    Raises:
        UserError: If that takes up too much memory, or gives no coefficients.
    """

    window_seconds: Annotated[float, SECONDS, "length of a frame"]
    hop_seconds: Annotated[float, SECONDS, "time from frame to frame"]
    highest_hz: Annotated[float, "(0, 1000000] Hz", "where the filters end"]
    filters: Annotated[int, FILTERS, "number of filters"]
    spacing: Annotated[Spacing, "how filters are spaced with frequency"]
    first: Annotated[int, FILTERS, "first coefficient, counted from 1"]
    last: Annotated[int, FILTERS, "last coefficient"]

    def __post_init__(self) -> None:
        ordered = 1 <= self.first <= self.last <= self.filters
        if not ordered or self.window_seconds > MAX_OVERLAP * self.hop_seconds:
            raise UserError(
                f"model.baseline: give window_seconds up to {MAX_OVERLAP} times hop_seconds, and "
                "1 <= first <= last <= filters."
            )

    def coefficients(self, trace: Array, sampling_rate: float) -> Array:
        """Return coefficients (frames, last - first + 1) float64 of a trace (samples,).

        A trace shorter than a frame is padded with zeros to one.
        """
        highest_hz = min(self.highest_hz, sampling_rate / 2)
        if highest_hz < self.highest_hz:
            log_once(
                log,
                f"The filters end at {highest_hz:g} Hz, half the sampling rate, in place of "
                f"model.baseline.highest_hz={self.highest_hz:g}.",
            )
        length = max(1, round(self.window_seconds * sampling_rate))
        hop = max(1, round(self.hop_seconds * sampling_rate))
        padded = np.pad(trace, (0, max(0, length - len(trace)))).astype(np.float64)
        frames = np.lib.stride_tricks.sliding_window_view(padded, length)[::hop]
        size = ZERO_PADDING * length
        spectrum = np.fft.rfft(frames * get_window("hamming", length), size)
        # triangles, each from the peak of the filter below it to that of the filter above
        edges = filter_edges(self.filters, highest_hz, self.spacing)
        frequencies = np.fft.rfftfreq(size, 1 / sampling_rate)
        rise = (frequencies - edges[:-2, None]) / np.diff(edges)[:-1, None]
        fall = (edges[2:, None] - frequencies) / np.diff(edges)[1:, None]
        energies = np.abs(spectrum) ** 2 @ np.minimum(rise, fall).clip(0).T
        floor = FLOOR * energies.mean() + np.finfo(np.float64).tiny
        cepstrum = dct(np.log(np.maximum(energies, floor)), type=2, norm="ortho", axis=1)
        kept: Array = cepstrum[:, self.first - 1 : self.last]
        return kept


def filter_edges(filters: int, highest_hz: float, spacing: str) -> Array:
    """Return edges and peaks (filters + 2,) in Hz, rising from 0 to ``highest_hz``.

    ``mel`` spaces them evenly in mel = 2595 log10(1 + f / 700), so that filters widen with
    frequency. ``decreasing`` is that bank mirrored, f to ``highest_hz`` - f: the widths are the
    same and narrow with frequency.
    """
    highest_mel = 2595 * np.log10(1 + highest_hz / 700)
    edges: Array = 700 * (10 ** (np.linspace(0, highest_mel, filters + 2) / 2595) - 1)
    return edges if spacing == "mel" else (highest_hz - edges)[::-1]


MAX_ITERATIONS = 500  # enough to converge: a hundred are not always


@dataclass
class MfccMixtures(EstimatorBaseline, Cepstra):
    """Log-likelihoods of all frames are summed, so that a whole trace is one fragment.

    A class has at most one Gaussian, of diagonal covariance, for each frame. The smallest variance
    is added to every one, so that none shrinks to one frame.
    """

    components: Annotated[int, "[1, 10000]", "Gaussians of each class"]
    min_variance: Annotated[float, "[0, inf)", "smallest variance of a coefficient"]

    kind: ClassVar = "haptic"
    budgeted: ClassVar = {"components": 1}

    def features(self, recording: Array) -> Array:
        """Return the coefficients of all frames (frames, last - first + 1)."""
        return self.coefficients(recording, self.sampling_rate)

    def make_estimator(self, seed: int) -> Any:  # noqa: ANN401
        """Return the mixture of one class, fitted by expectation-maximisation."""
        return GaussianMixture(
            self.components,
            covariance_type="diag",
            reg_covar=self.min_variance,
            max_iter=MAX_ITERATIONS,
            random_state=seed,
        )

    def fit(self, recordings: Sequence[Array], labels: npt.NDArray[np.int64], seed: int) -> None:
        """Fit a mixture to the frames of each class."""
        frames = [self.features(trace) for trace in recordings]
        self.estimator = []
        for label in range(int(labels.max()) + 1):
            rows = np.concatenate([frames[index] for index in np.flatnonzero(labels == label)])
            mixture = self.make_estimator(seed)
            mixture.set_params(n_components=min(self.components, len(rows)))
            self.estimator.append(mixture.fit(rows))

    def logits(self, recording: Array) -> Tensor:
        """Return the log-likelihoods (classes, 1) of the whole movement."""
        frames = self.features(recording)
        sums = [mixture.score_samples(frames).sum() for mixture in self.estimator]
        return torch.tensor(sums, dtype=torch.float64)[:, None]

    def count_parameters(self) -> int:
        """Count weights, means and variances, without what scikit-learn derives from them."""
        return sum(
            mixture.weights_.size + mixture.means_.size + mixture.covariances_.size
            for mixture in self.estimator
        )


@dataclass
class MfccNaiveBayes(EstimatorBaseline, Cepstra):
    """One mean and one variance for each class and coefficient; a whole trace is one fragment."""

    kind: ClassVar = "haptic"

    def features(self, recording: Array) -> Array:
        """Return the mean of the frames' coefficients (last - first + 1,)."""
        mean: Array = self.coefficients(recording, self.sampling_rate).mean(axis=0)
        return mean

    def make_estimator(self, seed: int) -> Any:  # noqa: ANN401  (nothing is random)
        """Return naive Bayes with normal densities."""
        return GaussianNB()
