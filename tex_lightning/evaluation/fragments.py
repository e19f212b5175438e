"""Confusion matrices of votes and fragments, and pairs of classes that need both senses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torchmetrics.functional.classification import multiclass_confusion_matrix

from tex_lightning.evaluation.outcomes import Outcome

Shares = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]


def vote_counts(outcomes: Sequence[Outcome], classes: list[str]) -> Counts:
    """Count samples by true class (row) and predicted class (column)."""
    return _confusion_matrix([(each.label, each.predicted, 1) for each in outcomes], classes)


def fragment_counts(outcomes: Sequence[Outcome], classes: list[str]) -> Counts:
    """Count fragments by true class (row) and the class they voted for (column)."""
    votes = [
        (outcome.label, predicted, count)
        for outcome in outcomes
        for predicted, count in outcome.fragment_votes.items()
    ]
    return _confusion_matrix(votes, classes)


def _confusion_matrix(votes: Sequence[tuple[str, str, int]], classes: list[str]) -> Counts:
    """Count votes, each given as true class, predicted class and how often."""
    index = {name: number for number, name in enumerate(classes)}
    numbers = [(index[label], index[predicted], count) for label, predicted, count in votes]
    target, predictions, repeats = torch.tensor(numbers, dtype=torch.long).reshape(-1, 3).T
    matrix: Counts = multiclass_confusion_matrix(
        predictions.repeat_interleave(repeats), target.repeat_interleave(repeats), len(classes),
        validate_args=False,  # a single class is refused otherwise
    ).numpy()  # fmt: skip
    return matrix


@dataclass(frozen=True)
class ConfusedPair:
    """Two classes that one sense mistakes for each other and the other keeps apart.

    Attributes:
        classes: The two names.
        confused_by: haptic or visual.
        confusion: Mean share of the fragments of either class taken for the other, by that sense.
        other: The same by the other sense.
    """

    classes: tuple[str, str]
    confused_by: str
    confusion: float
    other: float


def confused_pairs(
    haptic: npt.NDArray[np.int64],
    visual: npt.NDArray[np.int64],
    classes: list[str],
    most: int = 3,
) -> list[ConfusedPair]:
    """The pairs with the largest difference between the senses, ``most`` for each sense.

    Args:
        haptic: Fragment counts (classes, classes) of HapticNet, see :func:`fragment_counts`.
        visual: The same of VisualNet.
        classes: Names.
        most: Pairs for each sense; fewer where fewer are confused.
    """
    by_sense = {"haptic": _mutual(haptic), "visual": _mutual(visual)}
    pairs: list[ConfusedPair] = []
    for sense, other in (("haptic", "visual"), ("visual", "haptic")):
        gap = np.triu(by_sense[sense] - by_sense[other], k=1)
        for place in np.argsort(gap, axis=None)[::-1][:most]:
            row, column = np.unravel_index(place, gap.shape)
            if gap[row, column] > 0:
                names = (classes[row], classes[column])
                shares = (float(by_sense[name][row, column]) for name in (sense, other))
                pairs.append(ConfusedPair(names, sense, *shares))
    return pairs


def _mutual(counts: npt.NDArray[np.int64]) -> Shares:
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    mean: Shares = (shares + shares.T) / 2
    return mean
