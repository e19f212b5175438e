"""Tables of ``task=stability`` as CSV and on the screen."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tex_lightning.core.files import write_rows
from tex_lightning.evaluation.outcomes import wilson_interval
from tex_lightning.perturbations.table import Perturbation
from tex_lightning.report.table import make_table, print_tables
from tex_lightning.stability.system import System
from tex_lightning.stability.trial import BreakingPoint, Trial

Break = tuple[System, Perturbation, BreakingPoint]

COLUMNS = (
    "system", "modality", "perturbation", "severity", "test_samples", "vote_accuracy", "ci_low",
    "ci_high", "flip_rate",
)  # fmt: skip
DETAILS = (
    "system", "modality", "perturbation", "severity", "value", "unit", "refused",
    "probability_when_wrong", "probability_when_correct", "worst_class", "worst_class_accuracy",
)  # fmt: skip
BREAKS = (
    "system", "modality", "perturbation", "unit", "clean_accuracy", "least_accuracy", "reached",
    "severity", "value", "vote_accuracy", "refused", "first_classes",
)  # fmt: skip


def write_trials(trials: Sequence[Trial], directory: Path) -> None:
    """Write ``stability.csv`` and, with what else is known of each trial, ``details.csv``."""
    write_rows(directory / "stability.csv", COLUMNS, map(_line, trials))
    write_rows(directory / "details.csv", DETAILS, map(_detail, trials))


def write_breaks(breaks: Sequence[Break], directory: Path) -> None:
    """Write ``breaking_points.csv``; what never broke has ``reached`` false and no value."""
    write_rows(directory / "breaking_points.csv", BREAKS, (_break(*each) for each in breaks))


def _line(trial: Trial) -> tuple[Any, ...]:
    count = len(trial.labels)
    interval = wilson_interval(trial.correct, count)
    return (*_place(trial), count, trial.accuracy, *interval, trial.flip_rate)


def _detail(trial: Trial) -> tuple[Any, ...]:
    classes = trial.class_accuracy()
    worst = min(classes, key=lambda name: classes[name])
    harmed = trial.severity > 0
    value = trial.perturbation.value(trial.severity) if harmed else ""
    probabilities = (trial.probability_when(False), trial.probability_when(True))
    return (
        *_place(trial),
        value,
        trial.perturbation.unit,
        trial.refused,
        *("" if value is None else value for value in probabilities),
        worst,
        classes[worst],
    )


def _place(trial: Trial) -> tuple[Any, ...]:
    perturbation = trial.perturbation
    return trial.system.name, perturbation.modality, perturbation.name, trial.severity


def _break(system: System, perturbation: Perturbation, found: BreakingPoint) -> tuple[Any, ...]:
    head = (system.name, perturbation.modality, perturbation.name, perturbation.unit)
    bounds = (found.clean, found.least)
    trial = found.below
    if trial is None:
        return (*head, *bounds, "false", "", "", "", "", "")
    value = perturbation.value(trial.severity)
    first = " ".join(found.classes)
    return (*head, *bounds, "true", trial.severity, value, trial.accuracy, trial.refused, first)


def print_stability(results: dict[str, Any], directory: Path) -> None:
    """Print clean and mean error of each system and where it breaks, then what harms it most."""
    title = f"stability · {results['data']} · errors against {results['reference']}"
    figures = make_table(title, ["system"], ["clean votes", "mean error", "mCE", "flips", "breaks"])
    worst = make_table("what harms most", ["system", "perturbation"], ["error"])
    worst.add_column("class that suffers most", overflow="fold")
    for name, entry in results["systems"].items():
        if "clean" not in entry:
            figures.add_row(name, "meets none")
            continue
        clean, ratio, harm = entry["clean"], entry["corruption_error"], entry["worst_perturbation"]
        figures.add_row(
            name,
            f"{clean['vote_accuracy']:.1%} ({clean['correct']}/{clean['test_samples']})",
            f"{entry['mean_error']:.1%}",
            "" if ratio is None else f"{ratio['mean']:.2f}",
            f"{entry['mean_flip_rate']:.1%}",
            f"{entry['breaks']} of {entry['perturbations']}",
        )
        error = f"{harm['mean_error']:.0%}"
        worst.add_row(name, harm["name"], error, entry["worst_class"]["name"])
    print_tables(directory, figures, worst)
