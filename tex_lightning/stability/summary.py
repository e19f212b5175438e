"""Summaries of the trials of each system."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tex_lightning.evaluation.calibration import auroc
from tex_lightning.evaluation.outcomes import wilson_interval
from tex_lightning.perturbations.table import BOTH, SEVERITIES, SWAPPED, perturbations
from tex_lightning.stability.evaluator import Decision
from tex_lightning.stability.system import System
from tex_lightning.stability.trial import Bench, Trial

Errors = dict[str, float]


def summarise_system(system: System, trials: Sequence[Trial], reference: Errors) -> dict[str, Any]:
    """The entry of one system in ``results.json``.

    Args:
        system: The system.
        trials: Trials of all systems, severities 0 to 5.
        reference: :func:`mean_errors` of the reference system.
    """
    own = [trial for trial in trials if trial.system is system and trial.severity > 0]
    errors = mean_errors(own)
    entry: dict[str, Any] = {
        "kind": system.kind,
        "checkpoints": [str(member.checkpoint) for member in system.members],
        "perturbations": len(errors),
    }
    if not own:
        return entry
    clean = Trial(system, own[0].perturbation, 0, own[0].labels, own[0].clean, own[0].clean)
    held = {trial.perturbation.name for trial in own if trial.perturbation.held_out}
    worst = max(errors, key=lambda name: errors[name])
    classes = _class_accuracy(own)
    lowest = min(classes, key=lambda name: classes[name])
    return {
        **entry,
        "clean": {
            "vote_accuracy": clean.accuracy,
            "vote_ci95": wilson_interval(clean.correct, len(clean.labels)),
            "correct": clean.correct,
            "test_samples": len(clean.labels),
        },
        "mean_error": float(np.mean(list(errors.values()))),
        "mean_error_held_out": _mean([errors[name] for name in held]),
        "corruption_error": corruption_error(errors, reference),
        "corruption_error_held_out": corruption_error(
            {name: errors[name] for name in held}, reference
        ),
        "mean_flip_rate": float(np.mean([trial.flip_rate for trial in own])),
        "refused": sum(trial.refused for trial in own),
        "probability_when_wrong": _mean([trial.probability_when(False) for trial in own]),
        "probability_when_correct": _mean([trial.probability_when(True) for trial in own]),
        "worst_perturbation": {"name": worst, "mean_error": errors[worst]},
        "worst_class": {"name": lowest, "vote_accuracy": classes[lowest]},
        "perturbation_errors": errors,
    }


def mean_errors(trials: Sequence[Trial]) -> Errors:
    """Error of the votes, mean over severities 1 to 5, by the name of the perturbation."""
    errors: dict[str, list[float]] = {}
    for trial in trials:
        if trial.severity > 0:
            errors.setdefault(trial.perturbation.name, []).append(1 - trial.accuracy)
    return {name: float(np.mean(values)) for name, values in errors.items()}


def corruption_error(errors: Errors, reference: Errors) -> dict[str, Any] | None:
    """Mean corruption error: errors over those of the reference, mean over shared perturbations.

    As Hendrycks and Dietterich (2019) with another reference. A perturbation under which the
    reference makes no error has no ratio and is left out.

    Returns:
        ``mean``, and ``perturbations``, how many it is over; None if there are none.
    """
    shared = [name for name in errors if reference.get(name, 0) > 0]
    if not shared:
        return None
    mean = float(np.mean([errors[name] / reference[name] for name in shared]))
    return {"mean": mean, "perturbations": len(shared)}


def conflict_summary(system: System, bench: Bench) -> dict[str, Any]:
    """How well a FusionNet separates samples with recordings of two classes from those of one.

    The area under the ROC curve of three scores, each high for a conflict: 1 - agreement of the
    beliefs of its parts, 1 - share of the votes, and 1 - mean probability of the label. Every
    sample is there once as it is and once with each modality swapped. A system without such a
    perturbation has none.
    """
    swaps = [
        each
        for each in perturbations().values()
        if each.modality == BOTH and each.effect[1] == SWAPPED and system.meets(each)
    ]
    if not swaps:
        return {}
    clean = bench.trial(system, swaps[0], 0).decisions
    swapped = [
        made for each in swaps for made in bench.trial(system, each, SEVERITIES[-1]).decisions
    ]
    scores = {
        "conflict_auroc": "agreement",
        "conflict_auroc_share": "share",
        "conflict_auroc_probability": "probability",
    }
    return {
        name: auroc(_conflicts(clean, score), _conflicts(swapped, score))
        for name, score in scores.items()
    }


def _conflicts(decisions: Sequence[Decision], score: str) -> list[float]:
    """1 - the score of every decision that has it; a sample that was refused has none."""
    found = [getattr(made, score) for made in decisions if made.label is not None]
    return [1 - value for value in found if value is not None]


def _class_accuracy(trials: Sequence[Trial]) -> dict[str, float]:
    tables = [trial.class_accuracy() for trial in trials]
    return {name: float(np.mean([table[name] for table in tables])) for name in tables[0]}


def _mean(values: Sequence[float | None]) -> float | None:
    present = [value for value in values if value is not None]
    return float(np.mean(present)) if present else None
