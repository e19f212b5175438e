"""Charts of ``task=stability``: systems beside perturbations, and accuracy over severity."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from tex_lightning.perturbations.table import SEVERITIES
from tex_lightning.report.figures import draw_shares, make_grid
from tex_lightning.report.labels import brief
from tex_lightning.report.numbers import spread
from tex_lightning.report.style import Look, looks, styled
from tex_lightning.stability.trial import Trial

COLUMNS = 5  # of small charts
ENTRY = 1.7  # inches of a system in the legend


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
    figure, grid = make_grid(len(names), COLUMNS, (2.6, 2.3), sharey=True)
    for axes, name in zip(grid, names, strict=True):
        _curve(axes, [trial for trial in trials if trial.perturbation.name == name], drawn)
    for axes in grid[::COLUMNS]:
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
    for system, look in drawn.items():
        own = [trial for trial in trials if trial.system.name == system]
        severities = [trial.severity for trial in own]
        shares = [trial.accuracy for trial in own]
        axes.plot(
            severities,
            shares,
            color=look.colour,
            marker=look.marker,
            markersize=3,
            label=brief(system),
        )
    perturbation = trials[0].perturbation
    values = ["clean", *(f"{perturbation.value(severity):g}" for severity in SEVERITIES)]
    axes.set_xticks(range(len(values)), values, fontsize=6)
    axes.set_ylim(-0.03, 1.03)
    axes.yaxis.set_major_formatter(PercentFormatter(1))
    axes.set_title(perturbation.name)
    axes.set_xlabel(perturbation.unit)
