"""Choice of a system: the one-standard-error rule, the Pareto front, and budgets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

ROUNDING = 1e-9  # a single vote of difference is one standard error exactly, but for rounding
MIN_SAMPLES = 50  # of fewer, the one vote that a standard error allows is more than 2 % of them


@dataclass(frozen=True)
class Candidate:
    """A system to choose, as its votes show it.

    Attributes:
        name: The system's.
        cost: What it costs, in any unit; smaller is better.
        correct: Whether each vote is correct, by fold and sample; of samples that share a recording
            the share of correct ones, by fold and recording.
    """

    name: str
    cost: float
    correct: Mapping[tuple[int, str], float]

    @property
    def accuracy(self) -> float:
        """Share of correct votes."""
        return float(np.mean(list(self.correct.values())))


def partner(fold: int, folds: int) -> int:
    """The fold that is left out of training together with ``fold``: the one half the folds away.

    Networks that were trained on neither vote on both. A choice made on one fold is measured on
    the other: no counted vote was used for the choice, or comes from a network that was trained on
    the measured fold. On labels of pure noise nothing else is free of optimism. With an even number
    of folds each pair needs one training.
    """
    return (fold + folds // 2) % folds


def one_standard_error(candidates: Sequence[Candidate]) -> Candidate:
    """The cheapest candidate whose accuracy is within one standard error of the best one's.

    The standard error is that of the mean paired difference over the samples that both classify:
    what both get right or wrong says nothing about which is better. Where several are best, the
    cheapest of them is the one to compare with. Fewer samples than ``MIN_SAMPLES`` leave nothing to
    trade: there the cheapest of the most accurate is taken.

    The accuracy of the choice on the votes that it was made on is optimistic; see :func:`partner`.
    """
    best = min(candidates, key=lambda item: (-item.accuracy, item.cost))
    sufficient = [item for item in candidates if _within(best, item)]
    return min(sufficient, key=lambda item: (item.cost, -item.accuracy))


def _within(best: Candidate, other: Candidate) -> bool:
    first, second = best.correct, other.correct
    shared = [key for key in first if key in second]
    if not shared:  # different samples: compare as if independent
        pooled = [best.accuracy, other.accuracy]
        counts = [len(first), len(second)]
        variance = sum(p * (1 - p) / n for p, n in zip(pooled, counts, strict=True))
        error = np.sqrt(variance) if min(counts) >= MIN_SAMPLES else 0.0
        return bool(best.accuracy - other.accuracy <= error + ROUNDING)
    differences = np.array([first[key] - float(second[key]) for key in shared])
    many = len(shared) >= MIN_SAMPLES
    error = differences.std(ddof=1) / np.sqrt(len(shared)) if many else 0.0
    return bool(differences.mean() <= error + ROUNDING)


def pareto(points: Mapping[str, tuple[float, float]]) -> set[str]:
    """Names of the points (cost, accuracy) that no other point beats in both.

    Of points that are equal in both, all are kept.
    """
    return {
        name
        for name, (cost, accuracy) in points.items()
        if not any(
            other_cost <= cost
            and other_accuracy >= accuracy
            and (other_cost, other_accuracy) != (cost, accuracy)
            for other_cost, other_accuracy in points.values()
        )
    }


def within_budget(
    candidates: Sequence[Candidate], most_cost: float | None, least_accuracy: float | None
) -> Candidate | None:
    """The candidate to use under a limit of cost, of accuracy on all its votes, or of both.

    With a limit of cost alone the most accurate one, else the cheapest one; None if there is none.
    """
    left = [
        item
        for item in candidates
        if (most_cost is None or item.cost <= most_cost)
        and (least_accuracy is None or item.accuracy >= least_accuracy)
    ]
    if not left:
        return None
    if least_accuracy is None:
        return min(left, key=lambda item: (-item.accuracy, item.cost))
    return min(left, key=lambda item: (item.cost, -item.accuracy))
