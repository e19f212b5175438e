"""Histograms of rotation-invariant local binary patterns, with a linear classifier.

A stand-in for the row D8 of the paper's comparison, of which nothing but the name is known: eight
neighbours and no upright direction are our guess, and its figures are not D8's.
"""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import cv2
import numpy as np
from skimage.feature import local_binary_pattern
from sklearn.kernel_approximation import AdditiveChi2Sampler
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline

from tex_lightning.baselines.base import Array, EstimatorBaseline

NEIGHBOURS = 8
CODES = 2**NEIGHBOURS  # room for every pattern; turned ones share the smallest code


@dataclass
class LocalBinaryPatterns(EstimatorBaseline):
    """Patterns of eight neighbours up to rotation (Ojala et al. 2002), on grey photos.

    The histograms are compared by an additive chi-square kernel (Vedaldi and Zisserman 2012),
    written out as features of a logistic regression. Each radius has a histogram of its own.
    """

    radii: Annotated[list[int], "[1, 1000] pixels", "radii of the circles of neighbours"]
    strength: Annotated[float, "(0, inf)", "inverse strength C of the regularisation"]

    kind: ClassVar = "visual"

    def __post_init__(self) -> None:
        self.min_side = 2 * max(self.radii) + 1

    def features(self, recording: Array) -> Array:
        """Return histograms (len(radii) * CODES,) of the patterns, each with sum 1."""
        grey = cv2.cvtColor(recording, cv2.COLOR_RGB2GRAY)
        return np.concatenate([_histogram(grey, radius) for radius in self.radii])

    def make_estimator(self, seed: int) -> Any:  # noqa: ANN401
        """Return chi-square features and logistic regression."""
        return make_pipeline(
            AdditiveChi2Sampler(), LogisticRegression(C=self.strength, max_iter=1000)
        )


def _histogram(grey: Array, radius: int) -> Array:
    """Return shares (CODES,) of the patterns of pixels whose neighbours lie in the photo."""
    codes = local_binary_pattern(grey, NEIGHBOURS, radius, method="ror")  # type: ignore[no-untyped-call]
    inner = codes[radius:-radius, radius:-radius].astype(np.int64)
    shares: Array = np.bincount(inner.ravel(), minlength=CODES) / inner.size
    return shares
