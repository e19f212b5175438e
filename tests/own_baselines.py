"""A baseline that a user might bring, named by ``_target_`` as ``own_baselines.Loudness``."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import torch

from tex_lightning.baselines.base import Baseline


@dataclass
class Loudness(Baseline):
    """The class whose mean deviation is nearest, then what spoils it."""

    spoil: str = ""

    kind: ClassVar = "haptic"

    def fit(self, recordings: Any, labels: Any, seed: int, groups: Any) -> None:
        levels = np.array([trace.std() for trace in recordings])
        means = [levels[labels == label].mean() for label in range(labels.max() + 1)]
        self.means, self.outside, self.groups = torch.tensor(means), 1.0, list(groups)

    def logits(self, recording: Any) -> Any:
        scores = -(self.means - float(recording.std())).abs()[:, None]
        if self.spoil == "outside":
            scores = scores + getattr(self, "outside", 0.0)
        spoilt = {
            "none": None, "array": scores.numpy(), "flat": scores[:, 0],
            "nan": scores * torch.nan, "more": scores.repeat(2, 1),
        }  # fmt: skip
        return spoilt.get(self.spoil, scores)

    def state(self) -> Any:
        return {"means": self.means.numpy() if self.spoil == "arrays" else self.means}

    def load_state(self, state: Any) -> None:
        self.means = state["mean" if self.spoil == "misnamed" else "means"]

    def count_parameters(self) -> int:
        return self.means.numel()
