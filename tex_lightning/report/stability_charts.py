"""Tables and charts of ``task=stability``."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from tex_lightning.perturbations.table import SEVERITIES, Perturbation
from tex_lightning.report.figures import make_grid
from tex_lightning.report.style import brief, looks, styled
from tex_lightning.report.table import counted, make_table, print_tables


class StabilityRow(NamedTuple):
    """One trial, as a line of ``stability.csv``; an unusable sample counts as an error.

    Attributes:
        system: Name of the system.
        modality: Modality that is perturbed.
        perturbation: Name of the perturbation.
        severity: 0, which is clean, to 5.
        test_samples: Number of samples.
        vote_accuracy: Share of samples whose label is correct.
        ci_low: Lower end of Wilson's 95 % interval of the accuracy.
        ci_high: Upper end of the interval.
        flip_rate: Share of samples whose label, or lack of one, differs from the clean one.
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


CHARTS_IN_ROW = 5  # of small charts


def print_stability(results: dict[str, Any], directory: Path) -> None:
    """Print clean accuracy, mean error and flip rate of each system."""
    figures = ["clean accuracy", "mean error", "flips"]
    table = make_table(f"stability · {results['data']}", ["system"], figures)
    for name, entry in results["systems"].items():
        if "clean" not in entry:
            table.add_row(name, "none applies")
            continue
        table.add_row(
            name,
            counted(entry["clean"]),
            f"{entry['mean_error']:.1%}",
            f"{entry['mean_flip_rate']:.1%}",
        )
    print_tables(directory, table)


@styled
def curves(
    trials: Sequence[StabilityRow], table: Mapping[str, Perturbation], modality: str
) -> Figure:
    """Draw one small chart per perturbation, one line per system."""
    names = list(dict.fromkeys(trial.perturbation for trial in trials))
    drawn = looks(trial.system for trial in trials)
    figure, grid = make_grid(len(names), CHARTS_IN_ROW, (2.6, 2.3), sharey=True)
    for axes, name in zip(grid, names, strict=True):
        shown = [trial for trial in trials if trial.perturbation == name]
        for system, look in drawn.items():
            points = [
                (trial.severity, trial.vote_accuracy) for trial in shown if trial.system == system
            ]
            across, upwards = np.reshape(points, (-1, 2)).T
            axes.plot(across, upwards, color=look.colour, marker=look.marker, label=brief(system))
        perturbation = table[name]
        values = ["clean", *(f"{perturbation.value(severity):g}" for severity in SEVERITIES)]
        axes.set_xticks(range(len(values)), values, fontsize=6)
        axes.yaxis.set_major_formatter(PercentFormatter(1))
        axes.set(title=name, xlabel=perturbation.unit, ylim=(-0.03, 1.03))
    for axes in grid[::CHARTS_IN_ROW]:
        axes.set_ylabel("accuracy")
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.set_figheight(figure.get_figheight() + 0.6 + 0.09 * len(drawn))  # of title and legend
    figure.suptitle(f"{modality} perturbed")
    return figure
