"""Find the perturbation and the severity at which a system fails first.

Two answers for each system and perturbation: the first severity at which accuracy is significantly
lower than on the same samples unperturbed, and the first at which it has lost a stated share.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from tex_lightning.evaluation.comparison import exact_p
from tex_lightning.perturbations.table import Perturbation

LEVEL = 0.05  # of significance, over all severities of one perturbation together (Bonferroni)
KEPT_SHARE = 0.5  # of the accuracy on unperturbed samples; with less a system is broken


class StabilityRow(NamedTuple):
    """One trial, as a line of ``stability.csv``; an unusable sample counts as an error.

    Severity is from 0, which is clean, to 5; the interval is Wilson's of 95 %. ``flip_rate`` is the
    share of samples whose label, or lack of one, differs from the clean one. ``lost`` of them are
    correct clean and wrong perturbed, and ``gained`` the other way round.
    """

    system: str
    modality: str
    perturbation: str
    severity: float
    test_samples: int
    vote_accuracy: float
    ci_low: float
    ci_high: float
    flip_rate: float
    lost: int = 0
    gained: int = 0


class Failure(NamedTuple):
    """The failure of one system under one perturbation.

    Attributes:
        clean: The trial of severity 0.
        lower: The first trial that is significantly less accurate; None of none.
        broken: The first trial that keeps less than :data:`KEPT_SHARE` of the clean accuracy.
        breaking: Severity at which accuracy crosses that share, between two trials; None of none.
        mean_error: Over all severities but 0.
    """

    clean: StabilityRow
    lower: StabilityRow | None
    broken: StabilityRow | None
    breaking: float | None
    mean_error: float


def find_failures(trials: Sequence[StabilityRow]) -> list[Failure]:
    """Return where every system fails under every perturbation, what fails first in front.

    What breaks at the lowest severity is first, then what is lower from the lowest one, then what
    has the most errors.

    Args:
        trials: All severities of each system and perturbation, severity 0 included.
    """
    groups: dict[tuple[str, str], list[StabilityRow]] = {}
    for trial in trials:
        groups.setdefault((trial.system, trial.perturbation), []).append(trial)
    return sorted(map(_failure, groups.values()), key=_order)


def _order(failure: Failure) -> tuple[float, float, float]:
    never = float("inf")
    breaking = never if failure.breaking is None else failure.breaking
    return breaking, failure.lower.severity if failure.lower else never, -failure.mean_error


def _failure(trials: Sequence[StabilityRow]) -> Failure:
    clean, *perturbed = sorted(trials, key=lambda trial: trial.severity)
    level = LEVEL / max(len(perturbed), 1)
    worse = (trial for trial in perturbed if trial.lost > trial.gained)
    lower = next((trial for trial in worse if exact_p(trial.lost, trial.gained) < level), None)
    needed = KEPT_SHARE * clean.vote_accuracy
    before, broken, breaking = clean, None, None
    for trial in perturbed:
        if trial.vote_accuracy < needed:
            fall = (before.vote_accuracy - needed) / (before.vote_accuracy - trial.vote_accuracy)
            breaking = before.severity + fall * (trial.severity - before.severity)
            broken = trial
            break
        before = trial
    errors = [1 - trial.vote_accuracy for trial in perturbed]
    return Failure(clean, lower, broken, breaking, sum(errors) / max(len(errors), 1))


def failure_entry(failure: Failure, table: Mapping[str, Perturbation]) -> dict[str, Any]:
    """Return a failure as ``results.json`` has it, with values in the unit of its perturbation."""
    perturbation = table[failure.clean.perturbation]

    def trial(row: StabilityRow | None) -> dict[str, Any] | None:
        if row is None:
            return None
        return {
            "severity": row.severity,
            "value": perturbation.value(row.severity),
            "correct": round(row.vote_accuracy * row.test_samples),
            "test_samples": row.test_samples,
            "ci95": [row.ci_low, row.ci_high],
        }

    at = failure.breaking
    return {
        "system": failure.clean.system,
        "modality": perturbation.modality,
        "perturbation": perturbation.name,
        "unit": perturbation.unit,
        "clean": trial(failure.clean),
        "lower_from": trial(failure.lower),
        "broken_from": trial(failure.broken),
        "breaking_severity": at,
        "breaking_value": None if at is None else perturbation.value(at),
        "mean_error": failure.mean_error,
    }
