"""Hydra's counts and MultiRocket's features together, and a ridge classifier.

Dempster, Schmidt and Webb (2023), by the recipe of aeon's ``MultiRocketHydraClassifier``: among
the most accurate classifiers of time series.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import torch
from aeon.transformations.collection.convolution_based import HydraTransformer, MultiRocket
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.linear_model import RidgeClassifierCV
from sklearn.pipeline import make_pipeline, make_union
from sklearn.preprocessing import StandardScaler

from tex_lightning.baselines.base import Array
from tex_lightning.baselines.rocket import ALPHAS, MIN_KERNELS, Rocket
from tex_lightning.threads import computing_threads


@dataclass
class MultiRocketHydra(Rocket):
    """Both sets of features on standardised traces.

    Attributes:
        kernels: Kernels of MultiRocket; each gives four features of the trace and four of its
            differences.
        hydra_kernels: Kernels of Hydra in a group.
        hydra_groups: Groups of Hydra at every dilation.
    """

    kernels: int
    hydra_kernels: int
    hydra_groups: int

    kind: ClassVar = "haptic"

    def with_budget(self, budget: float) -> Self:
        """Fewer kernels and groups."""
        return replace(
            self,
            kernels=max(MIN_KERNELS, int(self.kernels * budget)),
            hydra_groups=max(2, int(self.hydra_groups * budget)),
        )

    def make_estimator(self, seed: int) -> Any:  # noqa: ANN401
        """Features side by side, each scaled in its own way."""
        hydra = make_pipeline(Hydra(self.hydra_kernels, self.hydra_groups, seed), SparseScaler())
        rocket = make_pipeline(
            MultiRocket(self.kernels, n_jobs=self.threads, random_state=seed), StandardScaler()
        )
        return make_pipeline(make_union(hydra, rocket), RidgeClassifierCV(alphas=ALPHAS))


class Hydra(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """aeon's ``HydraTransformer`` whose fitted part is arrays, for few traces at a time.

    Args:
        kernels: In a group.
        groups: At every dilation.
        seed: Seed of the kernels.

    Attributes:
        kernels_: (dilations, 2, kernels * groups / 2, 1, 9), of the trace and of its differences.
        samples_: Of a trace.
    """

    def __init__(self, kernels: int, groups: int, seed: int) -> None:
        self.kernels = kernels
        self.groups = groups
        self.seed = seed

    def fit(self, series: Array, labels: object = None) -> Self:
        """Draw the kernels for series (cases, 1, samples)."""
        self.samples_ = series.shape[-1]
        self.kernels_ = self._aeon()._hydra.W.numpy()
        return self

    def transform(self, series: Array) -> Array:
        """Counts (cases, features) float32, of a trace at a time to bound memory."""
        counter = self._aeon()
        counter._hydra.W = torch.from_numpy(self.kernels_)  # stored, not drawn again
        rows = [counter.transform(case[None]) for case in series]
        counts: Array = torch.cat(rows).numpy()
        return counts

    def _aeon(self) -> Any:  # noqa: ANN401
        """A transformer fitted to the length, leaving PyTorch's generator and threads alone."""
        counter = HydraTransformer(self.kernels, self.groups, random_state=self.seed)
        with torch.random.fork_rng(devices=[]), computing_threads():
            counter.fit(np.zeros((2, 1, self.samples_), dtype=np.float32))
        return counter


class SparseScaler(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Hydra's scaling: square roots standardised, zeros left at zero, rare counts held back.

    Attributes:
        mean_: (features,) of the square roots.
        scale_: (features,) deviation, and the fourth power of the share of zeros.
    """

    def fit(self, counts: Array, labels: object = None) -> Self:
        """Learn mean and scale of counts (cases, features)."""
        roots = np.sqrt(counts.clip(0))
        self.mean_ = roots.mean(axis=0)
        self.scale_ = roots.std(axis=0, ddof=1) + (roots == 0).mean(axis=0) ** 4 + 1e-8
        return self

    def transform(self, counts: Array) -> Array:
        """Scaled counts of the same shape."""
        roots = np.sqrt(counts.clip(0))
        scaled: Array = (roots - self.mean_) * (roots != 0) / self.scale_
        return scaled
