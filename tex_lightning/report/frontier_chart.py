"""Table and chart of ``task=frontier``: ``frontier.csv`` and ``frontier.png``."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, PercentFormatter

from tex_lightning.core.console import say
from tex_lightning.core.files import write_rows
from tex_lightning.report.style import Look, brief, looks, styled
from tex_lightning.report.table import make_table, print_table, print_tables

PROCEDURE = "procedure"  # kind of the point that measures the choice


@dataclass(frozen=True)
class Point:
    """A system of the family, as ``frontier.csv`` has it; or the procedure that chooses one.

    Attributes:
        system: Its name.
        kind: Its sense, ``fusion`` or ``procedure``.
        parameters: Number of weights; None for the procedure.
        macs: Multiply-accumulates of a sample; None where they are not counted.
        latency_ms_median: Median latency of a sample.
        latency_ms_p95: The 95th percentile of it.
        fit_seconds: Time of training, all folds together.
        vote_accuracy: Share of correct votes.
        ci_low: Wilson's 95 % interval of it.
        ci_high: The same.
        on_frontier: Whether no other system is both quicker and more accurate.
        chosen: Whether it is the one to use.
        test_samples: Test samples.
        chosen_in_folds: In how many folds the choice made on the fold's partner fell on it; None
            for the procedure.
        latency_ms_mean: Mean over samples of each one's median; what a system costs.
    """

    system: str
    kind: str
    parameters: int | None
    macs: int | None
    latency_ms_median: float
    latency_ms_p95: float
    fit_seconds: float
    vote_accuracy: float
    ci_low: float
    ci_high: float
    on_frontier: bool
    chosen: bool
    test_samples: int
    chosen_in_folds: int | None
    latency_ms_mean: float


def write_frontier(points: Sequence[Point], path: Path) -> None:
    """Write the procedure and then one line per system, quickest first."""
    columns = [column.name for column in fields(Point)]
    write_rows(path, columns, (astuple(point) for point in _by_latency(points)))


def _by_latency(points: Sequence[Point]) -> list[Point]:
    return sorted(points, key=lambda item: (item.kind != PROCEDURE, item.latency_ms_mean))


@styled
def frontier_figure(points: Sequence[Point]) -> Figure:
    """Draw accuracy with intervals over latency (log axis); dominated systems are hollow.

    The procedure that chooses is a black diamond, the chosen system has a black edge.
    """
    figure = Figure(figsize=(11, 6), layout="constrained")
    axes = figure.subplots()
    drawn = looks(point.system for point in points if point.kind != PROCEDURE)
    for point in _by_latency(points):
        look = drawn.get(point.system, Look("black", "D"))
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
        title="Accuracy against latency; the choice: each fold's votes by the system chosen on "
        "another fold",
    )
    axes.yaxis.set_major_formatter(PercentFormatter(1))
    for axis_formatter in (axes.xaxis.set_major_formatter, axes.xaxis.set_minor_formatter):
        axis_formatter(LogFormatter(minor_thresholds=(2, 0.5)))
    axes.grid(which="both")
    figure.legend(loc="outside right center")
    return figure


def print_frontier(points: Sequence[Point], directory: Path, command: str) -> None:
    """Print the procedure, one line per system, quickest first, and how to train the chosen one."""
    figures = ["votes", "95 % CI", "picks", "ms", "fit s", "parameters"]
    table = make_table("frontier", ["system"], figures)
    table.caption = "picks: in how many folds it is chosen; ms: mean of one sample"
    for point in _by_latency(points):
        table.add_row(
            point.system + (" (chosen)" if point.chosen else ""),
            f"{point.vote_accuracy:.1%}",
            f"{100 * point.ci_low:.1f}-{100 * point.ci_high:.1f}",
            "" if point.chosen_in_folds is None else str(point.chosen_in_folds),
            f"{point.latency_ms_mean:.1f}",
            f"{point.fit_seconds:.1f}",
            "" if point.parameters is None else f"{point.parameters:,}",
            style="bold" if point.kind == PROCEDURE else None if point.on_frontier else "dim",
        )
    print_table(table)
    for point in points:
        if point.kind == PROCEDURE:
            say(f"Expect {point.vote_accuracy:.1%} of such a choice ({point.system}).")
        if point.chosen:
            say(
                f"{point.system} is chosen on all votes of the tested folds, so its own "
                f"{point.vote_accuracy:.1%} is optimistic, and holds for these classes."
            )
            say(f"Train it with: {command}", wraps=False)
    print_tables(directory)
