"""Tables and charts of ``task=stability``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from tex_lightning.core.files import write_rows
from tex_lightning.evaluation.outcomes import wilson_interval
from tex_lightning.perturbations.table import SEVERITIES
from tex_lightning.report.durations import spread
from tex_lightning.report.figures import draw_shares, make_grid
from tex_lightning.report.style import Look, brief, looks, styled
from tex_lightning.report.table import make_table, print_tables

if TYPE_CHECKING:
    from tex_lightning.studies.trials import Break, Trial


COLUMNS = (
    "system", "modality", "perturbation", "severity", "test_samples", "vote_accuracy", "ci_low",
    "ci_high", "flip_rate",
)  # fmt: skip
DETAILS = (
    "system", "modality", "perturbation", "severity", "value", "unit", "refused",
    "probability_when_wrong", "probability_when_correct", "worst_class", "worst_class_accuracy",
)  # fmt: skip
CHARTS_IN_ROW = 5  # of small charts
ENTRY = 1.7  # inches of a system in the legend
BREAKS = (
    "system", "modality", "perturbation", "unit", "clean_accuracy", "least_accuracy", "reached",
    "severity", "value", "vote_accuracy", "refused", "first_classes",
)  # fmt: skip


def write_trials(trials: Sequence[Trial], directory: Path) -> None:
    """Write ``stability.csv`` and, with what else is known of each trial, ``details.csv``."""
    lines, details = [], []
    for trial in trials:
        perturbation, count = trial.perturbation, len(trial.labels)
        place = (trial.system.name, perturbation.modality, perturbation.name, trial.severity)
        interval = wilson_interval(trial.correct, count)
        lines.append((*place, count, trial.accuracy, *interval, trial.flip_rate))
        classes = trial.class_accuracy()
        worst = min(classes, key=lambda name: classes[name])
        value = perturbation.value(trial.severity) if trial.severity > 0 else ""
        probabilities = [trial.probability_when(correct) for correct in (False, True)]
        shown = ["" if probability is None else probability for probability in probabilities]
        details.append(
            (*place, value, perturbation.unit, trial.refused, *shown, worst, classes[worst])
        )
    write_rows(directory / "stability.csv", COLUMNS, lines)
    write_rows(directory / "details.csv", DETAILS, details)


def write_breaks(breaks: Sequence[Break], directory: Path) -> None:
    """Write ``breaking_points.csv``; what never broke has ``reached`` false and no value."""
    lines = []
    for system, perturbation, point in breaks:
        head = (system.name, perturbation.modality, perturbation.name, perturbation.unit)
        found: tuple[Any, ...] = ("false", "", "", "", "", "")
        if trial := point.below:
            value, classes = perturbation.value(trial.severity), " ".join(point.classes)
            found = ("true", trial.severity, value, trial.accuracy, trial.refused, classes)
        lines.append((*head, point.clean, point.least, *found))
    write_rows(directory / "breaking_points.csv", BREAKS, lines)


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


def stability_figures(trials: Sequence[Trial]) -> dict[str, Figure]:
    """Figures by title: ``heat_map``, and ``curves_MODALITY`` for what was perturbed."""
    figures = {"heat_map": heat_map(trials)}
    for modality in dict.fromkeys(trial.perturbation.modality for trial in trials):
        some = [trial for trial in trials if trial.perturbation.modality == modality]
        figures[f"curves_{modality}"] = curves(some, modality)
    return figures


@styled
def heat_map(trials: Sequence[Trial]) -> Figure:
    """Vote accuracy, mean over severities 1 to 5, of systems and perturbations."""
    systems = list(dict.fromkeys(trial.system.name for trial in trials))
    names = list(dict.fromkeys(trial.perturbation.name for trial in trials))
    cells: dict[tuple[str, str], list[float]] = {}
    for trial in trials:
        if trial.severity > 0:
            place = (trial.perturbation.name, trial.system.name)
            cells.setdefault(place, []).append(trial.accuracy)
    shares = np.full((len(names), len(systems)), np.nan)
    for (row, column), values in cells.items():
        shares[names.index(row), systems.index(column)] = np.mean(values)
    size = (3.5 + 0.9 * len(systems), 2.5 + 0.2 * len(names))
    figure = Figure(figsize=size, layout="constrained")
    found = np.argwhere(~np.isnan(shares)).tolist()
    texts = {(row, column): f"{shares[row, column]:.0%}" for row, column in found}
    axes = figure.subplots()
    draw_shares(axes, shares, names, systems, texts, "correct votes")
    axes.set_title(f"mean of severities 1 to 5, {_counted(trials)}")
    return figure


@styled
def curves(trials: Sequence[Trial], modality: str) -> Figure:
    """One small chart per perturbation, one line per system."""
    names = list(dict.fromkeys(trial.perturbation.name for trial in trials))
    drawn = looks(trial.system.name for trial in trials)
    figure, grid = make_grid(len(names), CHARTS_IN_ROW, (2.6, 2.3), sharey=True)
    for axes, name in zip(grid, names, strict=True):
        _curve(axes, [trial for trial in trials if trial.perturbation.name == name], drawn)
    for axes in grid[::CHARTS_IN_ROW]:
        axes.set_ylabel("correct votes")
    handles, systems = grid[0].get_legend_handles_labels()
    columns = min(len(systems), max(1, int(figure.get_figwidth() / ENTRY)))
    rows = -(-len(systems) // columns)
    figure.set_figheight(figure.get_figheight() + 0.4 + 0.17 * rows)  # of title and legend
    figure.legend(handles, systems, loc="outside lower center", ncols=columns)
    figure.suptitle(f"{modality} perturbed\n{_counted(trials)}")
    return figure


def _counted(trials: Sequence[Trial]) -> str:
    """How many test samples there were, least and most."""
    return spread([len(trial.labels) for trial in trials], "test samples", "d")


def _curve(axes: Axes, trials: Sequence[Trial], drawn: Mapping[str, Look]) -> None:
    """Draw accuracy over the severities of one perturbation."""
    for system, look in drawn.items():
        points = [
            (trial.severity, trial.accuracy) for trial in trials if trial.system.name == system
        ]
        axes.plot(
            *np.reshape(points, (-1, 2)).T, color=look.colour, marker=look.marker, markersize=3,
            label=brief(system),
        )  # fmt: skip
    perturbation = trials[0].perturbation
    values = ["clean", *(f"{perturbation.value(severity):g}" for severity in SEVERITIES)]
    axes.set_xticks(range(len(values)), values, fontsize=6)
    axes.set_ylim(-0.03, 1.03)
    axes.yaxis.set_major_formatter(PercentFormatter(1))
    axes.set(title=perturbation.name, xlabel=perturbation.unit)
