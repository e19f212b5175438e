"""Features of a pretrained trunk and a linear classifier, the plain way to reuse a network."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import torch
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GridSearchCV, StratifiedKFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from threadpoolctl import threadpool_limits
from torch import Tensor

from tex_lightning.baselines.base import Array, State, count_fitted, log_probabilities
from tex_lightning.baselines.estimators import dump_estimator, load_estimator
from tex_lightning.baselines.trunks import TrunkBaseline, layer_names, resized
from tex_lightning.errors import UserError
from tex_lightning.progress import track

STATISTICS = {
    "mean": lambda channels: channels.mean(dim=1),
    "max": lambda channels: channels.amax(dim=1),
    "std": lambda channels: channels.std(dim=1, correction=0),
}
INNER_FOLDS = 5


@dataclass
class FrozenLinear(TrunkBaseline):
    """Statistics of a frozen trunk's maps over the photo, standardised; logistic regression.

    Attributes:
        layers: Names of the trunk's layers whose maps are taken.
        statistics: Statistics of every channel over the photo: mean, max, std.
        strengths: Inverse strengths of regularisation C to choose from by cross-validation inside
            the training photos.

    Raises:
        UserError: If there is no such trunk, layer or statistic.
    """

    layers: list[str]
    statistics: list[str]
    strengths: list[float]

    def __post_init__(self) -> None:
        super().__post_init__()
        self.estimator: Any = None
        choices = {"layers": layer_names(self.trunk), "statistics": list(STATISTICS)}
        for key, allowed in choices.items():
            given = getattr(self, key)
            if not given or not set(given) <= set(allowed):
                raise UserError(
                    f"model.baseline.{key} is {given}: choose from {', '.join(allowed)}."
                )
        if not self.strengths or min(self.strengths) <= 0:
            raise UserError(f"model.baseline.strengths is {self.strengths}: give positive numbers.")

    def with_budget(self, budget: float) -> Self:
        """Fewer strengths to choose from."""
        return replace(self, strengths=self.strengths[: max(1, int(len(self.strengths) * budget))])

    def fit(self, recordings: Sequence[Array], labels: npt.NDArray[np.int64], seed: int) -> None:
        """Take the features of every photo once, and fit the classifier to them."""
        self.require_weights(seed)
        photos = track(recordings, "Features of the frozen trunk")
        features = np.stack([self.features(photo) for photo in photos])
        # On problems this small, BLAS threads wait for each other far longer than they compute.
        with threadpool_limits(limits=1):
            self.estimator = self._fitted(features, labels, seed)

    def _fitted(self, features: Array, labels: npt.NDArray[np.int64], seed: int) -> Any:  # noqa: ANN401
        strengths = self.strengths
        folds = min(INNER_FOLDS, int(np.bincount(labels).min()))
        if folds < 2:  # a class with a single photo cannot be divided
            strengths = [strengths[len(strengths) // 2]]
        if len(strengths) == 1:
            return _pipeline(strengths[0]).fit(features, labels)
        inner = StratifiedKFold(folds, shuffle=True, random_state=seed)
        grid = {"logisticregression__C": strengths}
        search = GridSearchCV(_pipeline(1.0), grid, cv=inner, scoring="neg_log_loss")
        return search.fit(features, labels).best_estimator_

    @torch.inference_mode()
    def features(self, photo: Array) -> Array:
        """Statistics (len(layers) * len(statistics) * channels,) float32 of a photo."""
        image = self.image(photo)
        factor = self.largest_factor(image)
        maps = self.maps(resized(image, factor) if factor < 1 else image, self.layers)
        rows = [maps[layer][0].flatten(1) for layer in self.layers]
        parts = [STATISTICS[name](channels) for channels in rows for name in self.statistics]
        vector: Array = torch.cat(parts).numpy()
        return vector

    def logits(self, recording: Array) -> Tensor:
        """Logarithms of the class probabilities, one fragment."""
        return log_probabilities(self.estimator, self.features(recording)[None])

    def state(self) -> State:
        """Trunk and classifier."""
        return {**super().state(), "estimator": dump_estimator(self.estimator)}

    def load_state(self, state: State) -> None:
        """Read both back."""
        super().load_state(state)
        self.estimator = load_estimator(state["estimator"])

    def count_parameters(self) -> int:
        """Weights of the trunk and of the classifier."""
        return super().count_parameters() + count_fitted(self.estimator)


def _pipeline(strength: float) -> Any:  # noqa: ANN401
    return make_pipeline(StandardScaler(), LogisticRegression(C=strength, tol=1e-3, max_iter=1000))
