"""Charts of ``task=stability``: systems beside perturbations, and accuracy over severity."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tex_lightning.perturbations.table import SEVERITIES
from tex_lightning.report.figures import draw_shares, make_grid
from tex_lightning.stability.trial import Trial

COLUMNS = 5  # of small charts


def stability_figures(trials: Sequence[Trial]) -> dict[str, Figure]:
    """Figures by title: ``heat_map``, and ``curves_MODALITY`` for what was perturbed."""
    figures = {"heat_map": heat_map(trials)}
    for modality in dict.fromkeys(trial.perturbation.modality for trial in trials):
        some = [trial for trial in trials if trial.perturbation.modality == modality]
        figures[f"curves_{modality}"] = curves(some, modality)
    return figures


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
    axes = draw_shares(figure, shares, names, systems, texts, "vote accuracy")
    axes.set_title("votes, mean of severities 1 to 5", fontsize=9)
    return figure


def curves(trials: Sequence[Trial], modality: str) -> Figure:
    """One small chart per perturbation, one line per system."""
    names = list(dict.fromkeys(trial.perturbation.name for trial in trials))
    systems = list(dict.fromkeys(trial.system.name for trial in trials))
    figure, grid = make_grid(len(names), COLUMNS, (2.6, 2.3), sharey=True)
    for axes, name in zip(grid, names, strict=True):
        _curve(axes, [trial for trial in trials if trial.perturbation.name == name], systems)
    handles = [
        grid[0].plot([], [], "o-", color=f"C{place}", markersize=3)[0]
        for place in range(len(systems))
    ]
    figure.legend(handles, systems, loc="outside lower center", ncols=min(len(systems), 6))
    figure.suptitle(f"votes over severity: {modality}", fontsize=10)
    return figure


def _curve(axes: Axes, trials: Sequence[Trial], systems: list[str]) -> None:
    for place, system in enumerate(systems):
        own = [trial for trial in trials if trial.system.name == system]
        severities = [trial.severity for trial in own]
        shares = [trial.accuracy for trial in own]
        axes.plot(severities, shares, "o-", color=f"C{place}", markersize=3)
    perturbation = trials[0].perturbation
    values = ["clean", *(f"{perturbation.value(severity):g}" for severity in SEVERITIES)]
    axes.set_xticks(range(len(values)), values, fontsize=6)
    axes.set_ylim(-0.03, 1.03)
    axes.tick_params(axis="y", labelsize=6)
    axes.set_title(perturbation.name, fontsize=8)
    axes.set_xlabel(perturbation.unit, fontsize=6)
