"""Confusion matrices of votes and fragments, and pairs of classes that need another sense."""

from collections.abc import Mapping, Sequence
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
    """Two classes that one sense mistakes for each other and another keeps apart.

    Attributes:
        classes: The two names.
        confused_by: A sense.
        confusion: Mean share of the fragments of either class taken for the other, by that sense.
        separated_by: The sense that confuses them least.
        other: The same share by that one.
    """

    classes: tuple[str, str]
    confused_by: str
    confusion: float
    separated_by: str
    other: float


def confused_pairs(
    counts: Mapping[str, Counts], classes: list[str], most: int = 3
) -> list[ConfusedPair]:
    """The pairs with the largest difference between the senses, ``most`` for each sense.

    Args:
        counts: Fragment counts (classes, classes) of the network of each sense, of two or more, see
            :func:`fragment_counts`.
        classes: Names.
        most: Pairs for each sense; fewer where fewer are confused.
    """
    mutual = {sense: _mutual(each) for sense, each in counts.items()}
    pairs: list[ConfusedPair] = []
    for sense, own in mutual.items():
        others = {name: each for name, each in mutual.items() if name != sense}
        least = np.minimum.reduce(list(others.values()))
        gap = np.triu(own - least, k=1)
        for place in np.argsort(gap, axis=None)[::-1][:most]:
            row, column = np.unravel_index(place, gap.shape)
            if gap[row, column] > 0:
                shares = {name: float(each[row, column]) for name, each in others.items()}
                best = min(shares, key=shares.__getitem__)
                names = (classes[row], classes[column])
                confusion = float(own[row, column])
                pairs.append(ConfusedPair(names, sense, confusion, best, shares[best]))
    return pairs


def _mutual(counts: npt.NDArray[np.int64]) -> Shares:
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    mean: Shares = (shares + shares.T) / 2
    return mean
