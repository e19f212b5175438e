"""The features that a network in closed form was fitted to, kept for fitting it again."""

from collections.abc import Hashable, Mapping, Sequence
from typing import Self

import torch
from torch import Tensor, nn


class TrainingRows(nn.Module):
    """Mean features of the training recordings, their classes, and what was recorded together.

    Features are kept in half precision: standardised by the network, they are then exact to a
    thousandth of their deviation. That is 2 bytes for each, 9 to 22 MB for 1,000 recordings.

    Attributes:
        features: (recordings, D) float16, the mean embedding of each recording.
        labels: (recordings,) int64 class indices.
        groups: (recordings,) int64, equal for what was recorded together.
    """

    features: Tensor
    labels: Tensor
    groups: Tensor

    def __init__(self, recordings: int, features: int) -> None:
        super().__init__()
        self.register_buffer("features", torch.zeros(recordings, features, dtype=torch.float16))
        self.register_buffer("labels", torch.zeros(recordings, dtype=torch.long))
        self.register_buffer("groups", torch.zeros(recordings, dtype=torch.long))

    @classmethod
    def of(cls, features: Tensor, labels: Tensor, groups: Sequence[Hashable]) -> Self:
        """Keep features (recordings, D) of recordings with these class indices and groups."""
        numbers = {group: number for number, group in enumerate(dict.fromkeys(groups))}
        largest = torch.finfo(torch.float16).max
        state = {
            "features": features.clamp(-largest, largest),
            "labels": labels,
            "groups": torch.tensor([numbers[group] for group in groups]),
        }
        return cls.from_state(state)

    @classmethod
    def from_state(cls, state: Mapping[str, Tensor]) -> Self:
        """Make rows of the sizes of a stored state, and load it.

        Raises:
            RuntimeError: If sizes do not fit, or a tensor is missing.
            ValueError: If the features have another number of axes.
        """
        recordings, features = state["features"].shape
        rows = cls(recordings, features)
        rows.load_state_dict(dict(state))
        return rows

    def with_recordings(self, features: Tensor, labels: Tensor) -> Self:
        """Return rows with more recordings (added, D), each a group of its own."""
        first = int(self.groups.max()) + 1
        more = type(self).of(features, labels, range(len(labels)))
        old, new = self.state_dict(), more.state_dict()
        new["groups"] += first
        return self.from_state({name: torch.cat([old[name], new[name]]) for name in old})
