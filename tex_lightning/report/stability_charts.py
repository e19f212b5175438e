"""Tables and charts of ``task=stability``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from tex_lightning.core.files import write_rows
from tex_lightning.evaluation.outcomes import wilson_interval
from tex_lightning.perturbations.table import SEVERITIES
from tex_lightning.report.figures import draw_shares, make_grid
from tex_lightning.report.style import brief, looks, styled
from tex_lightning.report.table import counted, make_table, print_tables

if TYPE_CHECKING:
    from tex_lightning.studies.trials import Break, Trial


COLUMNS = (
    "system", "modality", "perturbation", "severity", "test_samples", "vote_accuracy", "ci_low",
    "ci_high", "flip_rate",
)  # fmt: skip
BREAKS = (
    "system", "modality", "perturbation", "unit", "clean_accuracy", "least_accuracy", "reached",
    "severity", "value", "vote_accuracy", "refused", "first_classes",
)  # fmt: skip
CHARTS_IN_ROW = 5  # of small charts


def write_trials(trials: Sequence[Trial], directory: Path) -> None:
    """Write ``stability.csv``."""
    lines = [
        (
            trial.system.name, trial.perturbation.modality, trial.perturbation.name, trial.severity,
            len(trial.labels), trial.accuracy, *wilson_interval(trial.correct, len(trial.labels)),
            trial.flip_rate,
        )
        for trial in trials
    ]  # fmt: skip
    write_rows(directory / "stability.csv", COLUMNS, lines)


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
    """Print clean and mean error of each system, and where it breaks."""
    title = f"stability · {results['data']} · errors against {results['reference']}"
    figures = ["clean votes", "mean error", "mCE", "flips", "breaks"]
    table = make_table(title, ["system"], figures)
    for name, entry in results["systems"].items():
        if "clean" not in entry:
            table.add_row(name, "meets none")
            continue
        ratio = entry["corruption_error"]
        table.add_row(
            name,
            counted(entry["clean"]),
            f"{entry['mean_error']:.1%}",
            "" if ratio is None else f"{ratio['mean']:.2f}",
            f"{entry['mean_flip_rate']:.1%}",
            f"{entry['breaks']} of {entry['perturbations']}",
        )
    print_tables(directory, table)


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
    cells: dict[tuple[int, int], list[float]] = {}
    for trial in trials:
        if trial.severity > 0:
            place = (names.index(trial.perturbation.name), systems.index(trial.system.name))
            cells.setdefault(place, []).append(trial.accuracy)
    shares = np.full((len(names), len(systems)), np.nan)
    for place, values in cells.items():
        shares[place] = np.mean(values)
    size = (3.5 + 0.9 * len(systems), 2.5 + 0.2 * len(names))
    figure = Figure(figsize=size, layout="constrained")
    texts = {place: f"{shares[place]:.0%}" for place in cells}
    axes = figure.subplots()
    draw_shares(axes, shares, names, systems, texts, "correct votes")
    axes.set_title("mean of severities 1 to 5")
    return figure


@styled
def curves(trials: Sequence[Trial], modality: str) -> Figure:
    """One small chart per perturbation, one line per system."""
    names = list(dict.fromkeys(trial.perturbation.name for trial in trials))
    drawn = looks(trial.system.name for trial in trials)
    figure, grid = make_grid(len(names), CHARTS_IN_ROW, (2.6, 2.3), sharey=True)
    for axes, name in zip(grid, names, strict=True):
        own = [trial for trial in trials if trial.perturbation.name == name]
        for system, look in drawn.items():
            points = [
                (trial.severity, trial.accuracy) for trial in own if trial.system.name == system
            ]
            across, upwards = np.reshape(points, (-1, 2)).T
            axes.plot(across, upwards, color=look.colour, marker=look.marker, label=brief(system))
        perturbation = own[0].perturbation
        values = ["clean", *(f"{perturbation.value(severity):g}" for severity in SEVERITIES)]
        axes.set_xticks(range(len(values)), values, fontsize=6)
        axes.yaxis.set_major_formatter(PercentFormatter(1))
        axes.set(title=name, xlabel=perturbation.unit, ylim=(-0.03, 1.03))
    for axes in grid[::CHARTS_IN_ROW]:
        axes.set_ylabel("correct votes")
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.set_figheight(figure.get_figheight() + 0.6 + 0.09 * len(drawn))  # of title and legend
    figure.suptitle(f"{modality} perturbed")
    return figure
