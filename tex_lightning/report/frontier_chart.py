"""Table and chart of ``task=frontier``: ``frontier.csv`` and ``frontier.png``."""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, PercentFormatter

from tex_lightning.core.console import console, say
from tex_lightning.core.files import write_rows
from tex_lightning.report.style import brief, looks, styled
from tex_lightning.report.table import make_table, print_tables


@dataclass(frozen=True)
class Point:
    """A system of the family, as ``frontier.csv`` has it.

    Attributes:
        system: Its name.
        kind: Its sense, or ``fusion``.
        parameters: Number of weights.
        macs: Multiply-accumulates of a sample; None where they are not counted.
        latency_ms_median: Median latency of a sample.
        latency_ms_p95: The 95th percentile of it.
        fit_seconds: Mean time of a training.
        vote_accuracy: Share of correct votes.
        ci_low: Wilson's 95 % interval of it.
        ci_high: The same.
        on_frontier: Whether no other system is both quicker and more accurate.
        chosen: Whether it is the one to use.
        latency_ms_mean: Mean over samples of each one's median; what a system costs.
    """

    system: str
    kind: str
    parameters: int
    macs: int | None
    latency_ms_median: float
    latency_ms_p95: float
    fit_seconds: float
    vote_accuracy: float
    ci_low: float
    ci_high: float
    on_frontier: bool
    chosen: bool
    latency_ms_mean: float


def write_frontier(points: Sequence[Point], path: Path) -> None:
    """Write one line per system."""
    columns = [column.name for column in fields(Point)]
    write_rows(path, columns, map(astuple, points))


@styled
def frontier_figure(points: Sequence[Point]) -> Figure:
    """Draw accuracy with intervals over latency (log axis).

    Dominated systems are hollow, the chosen one has a black edge.
    """
    figure = Figure(figsize=(11, 6), layout="constrained")
    axes = figure.subplots()
    drawn = looks(point.system for point in points)
    for point in points:
        look = drawn[point.system]
        bounds = [
            [max(point.vote_accuracy - point.ci_low, 0)],
            [max(point.ci_high - point.vote_accuracy, 0)],
        ]
        axes.errorbar(
            point.latency_ms_mean, point.vote_accuracy, bounds, color=look.colour, capsize=2,
            marker=look.marker, markersize=8, markeredgecolor="black" if point.chosen else None,
            markerfacecolor=look.colour if point.on_frontier else "white",
            label=brief(point.system) + (" (chosen)" if point.chosen else ""),
        )  # fmt: skip
    line = sorted((x.latency_ms_mean, x.vote_accuracy) for x in points if x.on_frontier)
    axes.plot(*np.transpose(line), "k--", linewidth=0.8, drawstyle="steps-post")
    axes.set(
        xscale="log",
        xlabel="ms for one sample, features included (mean over samples)",
        ylabel="vote accuracy with Wilson's 95 % interval",
        title="Accuracy against latency",
    )
    axes.yaxis.set_major_formatter(PercentFormatter(1))
    for axis_formatter in (axes.xaxis.set_major_formatter, axes.xaxis.set_minor_formatter):
        axis_formatter(LogFormatter(minor_thresholds=(2, 0.5)))
    axes.grid(which="both")
    figure.legend(loc="outside right center")
    return figure


def print_frontier(
    points: Sequence[Point], procedure: Mapping[str, Any], directory: Path, command: str
) -> None:
    """Print one line per system, what to expect of the choice, and how to train the chosen one.

    Args:
        points: The systems, fastest first.
        procedure: ``procedure`` of ``results.json``.
        directory: The run folder.
        command: The command that trains the chosen system.
    """
    table = make_table("frontier", ["system"], ["votes", "95 % CI", "ms", "fit s", "parameters"])
    table.caption = "ms: mean of one sample"
    for point in points:
        table.add_row(
            point.system + (" (chosen)" if point.chosen else ""),
            f"{point.vote_accuracy:.1%}",
            f"{100 * point.ci_low:.1f}-{100 * point.ci_high:.1f}",
            f"{point.latency_ms_mean:.1f}",
            f"{point.fit_seconds:.1f}",
            f"{point.parameters:,}",
            style=None if point.on_frontier else "dim",
        )
    console.print(table)
    (chosen,) = (point for point in points if point.chosen)
    say(
        f"Expect {procedure['vote_accuracy']:.1%} of such a choice: each fold by the system chosen "
        f"on another. {chosen.system} is chosen on all votes of the tested folds, so its own "
        f"{chosen.vote_accuracy:.1%} is optimistic, and holds for these classes."
    )
    say(f"Train it with: {command}", wraps=False)
    print_tables(directory)
