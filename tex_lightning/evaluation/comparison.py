"""Compare systems: exact McNemar tests, paired samples of several senses, and the choice of one."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from statistics import fmean

import numpy as np
from scipy.stats import binomtest

from tex_lightning.evaluation.outcomes import Outcome


def mcnemar(one: Sequence[bool], other: Sequence[bool]) -> tuple[int, int, float]:
    """Perform the exact McNemar test of two systems' successes on the same samples.

    Only samples that exactly one of them classifies correctly say anything; under the hypothesis
    of equal accuracy each of these is a fair coin.

    Returns:
        How often only ``one`` was correct, how often only ``other``, and the two-sided p-value.
    """
    first = sum(ours and not theirs for ours, theirs in zip(one, other, strict=True))
    second = sum(theirs and not ours for ours, theirs in zip(one, other, strict=True))
    return first, second, exact_p(first, second)


def exact_p(first: int, second: int) -> float:
    """Return the two-sided p-value of the exact McNemar test from the counts that differ."""
    return float(binomtest(first, first + second).pvalue) if first + second else 1.0


ROUNDING = 1e-9  # a single vote of difference is one standard error exactly, but for rounding
MIN_SAMPLES = 50  # of fewer, the one vote that a standard error allows is more than 2 % of them


Votes = Mapping[tuple[int, str], float]  # share of correct ones, by fold and sample or recording


def one_standard_error(costs: Mapping[str, float], votes: Mapping[str, Votes]) -> str:
    """Choose the cheapest system whose accuracy is within one standard error of the best one's.

    The standard error is that of the mean paired difference over the samples that both classify:
    what both get right or wrong says nothing about which is better. Where several are best, the
    cheapest of them is the one to compare with. Fewer samples than ``MIN_SAMPLES`` leave nothing to
    trade: there the cheapest of the most accurate is taken.

    The accuracy of the choice on the votes that it was made on is optimistic.

    Args:
        costs: Cost of each system, in any unit; smaller is better.
        votes: Whether each vote of a system is correct; of samples that share a recording the
            share of correct ones.
    """
    accuracies = {name: float(np.mean(list(votes[name].values()))) for name in costs}
    best = min(costs, key=lambda name: (-accuracies[name], costs[name]))
    sufficient = [name for name in costs if _within(votes[best], votes[name])]
    return min(sufficient, key=lambda name: (costs[name], -accuracies[name]))


def _within(best: Votes, other: Votes) -> bool:
    """Return whether the accuracy of a system is within one standard error of the best one's."""
    shared = [key for key in best if key in other]
    if not shared:  # different samples: compare as if independent
        first, second = (np.array(list(votes.values())) for votes in (best, other))
        means, counts = [first.mean(), second.mean()], [len(first), len(second)]
        variance = sum(p * (1 - p) / n for p, n in zip(means, counts, strict=True))
        error = np.sqrt(variance) if min(counts) >= MIN_SAMPLES else 0.0
        return bool(means[0] - means[1] <= error + ROUNDING)
    differences = np.array([best[key] - float(other[key]) for key in shared])
    many = len(shared) >= MIN_SAMPLES
    error = differences.std(ddof=1) / np.sqrt(len(shared)) if many else 0.0
    return bool(differences.mean() <= error + ROUNDING)


def pareto(points: Mapping[str, tuple[float, float]]) -> set[str]:
    """Return names of the points (cost, accuracy) that no other beats in both; equals are kept."""
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


def pair(
    outcomes: Sequence[Outcome], joint: Sequence[Outcome]
) -> list[tuple[str, bool, bool]] | None:
    """Return each joint sample's independent recording, and whether each system is correct.

    That recording is of the modality with the fewest recordings, which several samples share.

    Args:
        outcomes: Outcomes of a system that uses some of the modalities.
        joint: Outcomes of a system that uses all of them.

    Returns:
        None if no joint sample holds what the first system has classified.
    """
    modalities = sorted(outcomes[0].files)
    if not set(modalities) <= set(joint[0].files):
        return None
    known = {outcome.sample: outcome.correct for outcome in outcomes}
    files = [[outcome.files[modality] for outcome in joint] for modality in joint[0].files]
    recordings = min(files, key=lambda names: len({*names}))
    names = ["|".join(outcome.files[modality] for modality in modalities) for outcome in joint]
    return [
        (recording, known[name], outcome.correct)
        for recording, name, outcome in zip(recordings, names, joint, strict=True)
        if name in known
    ] or None


def correct_shares(outcomes: Sequence[Outcome], joint: Sequence[Outcome]) -> dict[str, float]:
    """Return the accuracy on the joint samples by independent recording; see :func:`pair`.

    Where the joint samples do not hold the system's own, by its own samples.
    """
    pairs = pair(outcomes, joint)
    if pairs is None:
        return {outcome.sample: float(outcome.correct) for outcome in outcomes}
    votes = defaultdict(list)
    for recording, correct, _ in pairs:
        votes[recording].append(correct)
    return {recording: fmean(correct) for recording, correct in votes.items()}
