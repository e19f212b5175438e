"""Which system is enough: the one-standard-error rule, the Pareto line, and budgets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Candidate:
    """A system to choose, as its votes in a cross-validation show it.

    Attributes:
        name: The system's.
        cost: What it costs, in any unit; smaller is better.
        votes: Whether each vote is correct, by tested fold and sample.
    """

    name: str
    cost: float
    votes: Mapping[int, Mapping[str, bool]]

    @property
    def correct(self) -> dict[tuple[int, str], bool]:
        """Whether each vote is correct, by fold and sample together."""
        return {
            (fold, sample): correct
            for fold, votes in self.votes.items()
            for sample, correct in votes.items()
        }

    @property
    def accuracy(self) -> float:
        """Share of correct votes."""
        return float(np.mean(list(self.correct.values())))

    def without(self, fold: int) -> "Candidate":
        """The same without the votes on the samples of one fold, in whichever fold they stand."""
        others = {
            other: {key: correct for key, correct in votes.items() if key not in self.votes[fold]}
            for other, votes in self.votes.items()
            if other != fold
        }
        return replace(self, votes=others)


def one_standard_error(candidates: Sequence[Candidate]) -> Candidate:
    """The cheapest candidate whose accuracy is within one standard error of the best one's.

    The standard error is that of the mean paired difference over the samples that both classify:
    what both get right or wrong says nothing about which is better. Where several are best, the
    cheapest of them is the one to compare with.
    """
    best = min(candidates, key=lambda item: (-item.accuracy, item.cost))
    sufficient = [item for item in candidates if _within(best, item)]
    return min(sufficient, key=lambda item: (item.cost, -item.accuracy))


def choose_without_each_fold(candidates: Sequence[Candidate]) -> dict[int, str]:
    """For every tested fold the name of the system that is chosen without the votes on it.

    The votes of these systems on these folds measure the procedure "choose by one standard error,
    then use what was chosen": no vote is counted that its own choice has seen. The choice looks
    at the out-of-sample votes of one cross-validation (as BBC-CV does, Tsamardinos et al., Machine
    Learning 2018), so that nothing is trained for it alone. The price is that the systems voting on
    the other folds were fitted to this one as well, which leaves a little optimism where they fit
    noise; systems fitted anew without each fold would leave none, for many times the training.

    Returns:
        Nothing where a single fold was tested, as no votes are left to choose on.
    """
    folds = list(candidates[0].votes)
    if len(folds) < 2:
        return {}
    return {
        fold: one_standard_error([item.without(fold) for item in candidates]).name for fold in folds
    }


def _within(best: Candidate, other: Candidate) -> bool:
    first, second = best.correct, other.correct
    shared = [key for key in first if key in second]
    if not shared:  # different samples: compare as if independent
        pooled = [best.accuracy, other.accuracy]
        counts = [len(first), len(second)]
        variance = sum(p * (1 - p) / n for p, n in zip(pooled, counts, strict=True))
        return bool(best.accuracy - other.accuracy <= np.sqrt(variance))
    differences = np.array([first[key] - float(second[key]) for key in shared])
    error = differences.std(ddof=1) / np.sqrt(len(differences)) if len(differences) > 1 else 0.0
    return bool(differences.mean() <= error)


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
