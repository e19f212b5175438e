"""Cepstral coefficients of frames and a mixture of Gaussians for each class.

After the TUM haptic texture database (Strese et al., Haptics Symposium/HAVE 2014), whose numbers
of coefficients and components are not public.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
import torch
from sklearn.mixture import GaussianMixture
from torch import Tensor

from tex_lightning.baselines.base import Array, Baseline, State
from tex_lightning.baselines.estimators import dump_estimator, load_estimator
from tex_lightning.baselines.mfcc import Cepstra
from tex_lightning.errors import UserError

MAX_ITERATIONS = 500  # enough to converge: a hundred are not always


@dataclass
class MfccMixtures(Baseline, Cepstra):
    """Log-likelihoods of all frames are summed, so that a whole trace is one fragment.

    Attributes:
        components: Gaussians with diagonal covariance for each class, at most one for each frame.
        min_variance: Added to every variance, so that no component shrinks to one frame.
    """

    components: int
    min_variance: float

    kind: ClassVar = "haptic"

    def __post_init__(self) -> None:
        self.check()
        if self.components < 1 or self.min_variance <= 0:
            raise UserError(
                "model.settings: components must be at least 1 and min_variance exceed 0."
            )
        self.mixtures: list[Any] = []

    def with_budget(self, budget: float) -> Self:
        """Fewer components."""
        return replace(self, components=max(1, int(self.components * budget)))

    def fit(self, recordings: Sequence[Array], labels: npt.NDArray[np.int64], seed: int) -> None:
        """Fit each class's mixture to the frames of its recordings by expectation-maximisation."""
        frames = [self.coefficients(trace, self.sampling_rate) for trace in recordings]
        self.mixtures = []
        for label in range(int(labels.max()) + 1):
            own = np.concatenate(
                [part for part, of in zip(frames, labels, strict=True) if of == label]
            )
            mixture = GaussianMixture(
                min(self.components, len(own)),
                covariance_type="diag",
                reg_covar=self.min_variance,
                max_iter=MAX_ITERATIONS,
                random_state=seed,
            )
            self.mixtures.append(mixture.fit(own))

    def logits(self, recording: Array) -> Tensor:
        """Log-likelihoods (classes, 1) of the whole movement."""
        frames = self.coefficients(recording, self.sampling_rate)
        sums = [mixture.score_samples(frames).sum() for mixture in self.mixtures]
        return torch.tensor(sums, dtype=torch.float64)[:, None]

    def state(self) -> State:
        """The mixtures as bytes."""
        return {"mixtures": dump_estimator(self.mixtures)}

    def load_state(self, state: State) -> None:
        """Read the mixtures back."""
        self.mixtures = load_estimator(state["mixtures"])

    def count_parameters(self) -> int:
        """Weights, means and variances; what scikit-learn derives from them does not count."""
        return sum(
            mixture.weights_.size + mixture.means_.size + mixture.covariances_.size
            for mixture in self.mixtures
        )
