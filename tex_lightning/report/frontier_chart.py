"""Tables and chart of ``task=frontier``: ``frontier.csv``, ``senses.csv``, ``frontier.png``."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from adjustText import adjust_text
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, PercentFormatter
from matplotlib.transforms import ScaledTranslation

from tex_lightning.core.console import say
from tex_lightning.core.files import write_lines
from tex_lightning.evaluation.comparison import MIN_SAMPLES
from tex_lightning.report.style import GUIDE, looks, styled
from tex_lightning.report.table import make_table, print_table, print_tables
from tex_lightning.text import printable

PROCEDURE = "procedure"  # kind of the point that measures the choice
DIM = "#555555"  # names of dominated systems


@dataclass(frozen=True)
class AddedSense:
    """One sense more: the system without it and the system with it, on the same samples.

    Attributes:
        before: System without the sense.
        after: System with it.
        sense: Sense that is added.
        order: ``together`` asks all senses at once, ``sequential`` the next only if unsure.
        added_ms: Mean latency that it adds.
        test_samples: Test samples that both classify.
        repaired: Samples wrong without the sense and correct with it.
        broken: Samples correct without the sense and wrong with it.
        p_value: p of the exact McNemar test of both.
    """

    before: str
    after: str
    sense: str
    order: str
    added_ms: float
    test_samples: int
    repaired: int
    broken: int
    p_value: float

    @property
    def label(self) -> str:
        """Return what it adds, in words."""
        return (
            f"+{self.sense}: {self.repaired} repaired, {self.broken} broken, "
            f"{self.added_ms:+.1f} ms (p = {self.p_value:.2g})"
        )


def write_added_senses(added: Sequence[AddedSense], path: Path) -> None:
    """Write one line per sense added to a subset."""
    write_lines(path, AddedSense, added)


def print_added_senses(steps: Sequence[AddedSense]) -> None:
    """Print what each sense that is added adds."""
    for step in steps:
        say(f"{step.before} to {step.after}: {step.label}, {step.test_samples} samples.")


@dataclass(frozen=True)
class Point:
    """One system, as a line of ``frontier.csv``, or the procedure that chooses among them.

    Attributes:
        system: Its name in the family.
        kind: Its sense, or fusion; procedure for the choice itself, whose votes on a fold are those
            of the system chosen on its partner, and whose times are means over them.
        parameters: Numbers that were fitted; None for the procedure.
        macs: Multiply-accumulates of a test sample, mean of what was done; None where they are
            outside PyTorch, and for the procedure.
        latency_ms_median: From a decoded sample to its label, features included; of all calls.
        latency_ms_p95: The 95th percentile.
        fit_seconds: Mean of the folds.
        vote_accuracy: On the tested folds.
        ci_low: Wilson's 95 % interval.
        ci_high: The same.
        on_frontier: Whether no other system is as quick and as accurate, and better in one.
        chosen: Whether it is the choice on all votes, by which its own accuracy is optimistic.
        test_samples: Number of tested samples.
        chosen_in_folds: For how many tested folds the choice on the fold's partner fell on it; None
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
    write_lines(path, Point, _by_latency(points))


@styled
def frontier_figure(points: Sequence[Point]) -> Figure:
    """Draw accuracy with intervals over latency (log axis); dominated systems are hollow.

    The procedure that chooses is a hollow diamond. Every point has its name beside it, moved to
    where it covers neither points nor other names.
    """
    figure = Figure(figsize=(11, 7), layout="constrained")
    axes = figure.subplots()
    colours = looks(point.system for point in points if point.kind != PROCEDURE)
    for point in _by_latency(points):
        procedure = point.kind == PROCEDURE
        colour = "black" if procedure else colours[point.system].colour
        place = (point.latency_ms_mean, point.vote_accuracy)
        low, high = point.vote_accuracy - point.ci_low, point.ci_high - point.vote_accuracy
        bounds = [[max(low, 0)], [max(high, 0)]]
        axes.errorbar(*place, yerr=bounds, color=colour, elinewidth=0.8, capsize=2)
        axes.scatter(
            *place, s=12 + 10 * (max(point.parameters or 0, 1000) / 1000) ** 0.4,
            marker="D" if procedure else "o", zorder=5 if procedure else 3,
            facecolors=colour if point.on_frontier else "white",
            edgecolors="black" if point.chosen else colour, linewidths=1.5 if point.chosen else 1,
        )  # fmt: skip
    line = sorted((x.latency_ms_mean, x.vote_accuracy) for x in points if x.on_frontier)
    axes.plot(*np.transpose(line), "k--", linewidth=0.8, drawstyle="steps-post")
    counts = sorted({point.test_samples for point in points if point.kind != PROCEDURE})
    axes.set(
        xscale="log",
        xlabel="ms for one sample, features included (mean over samples)",
        ylabel="vote accuracy with Wilson's 95 % interval",
        title=f"Accuracy against latency, {' or '.join(map(str, counts))} test samples\n"
        "diamond: what to expect of the choice, each fold's votes by the system chosen on another "
        "fold;\nblack edge: the system chosen on all of these votes, and so optimistic; area grows "
        "with parameters; hollow: dominated",
    )
    axes.margins(x=0.15, y=0.15)  # room for names
    axes.yaxis.set_major_formatter(PercentFormatter(1))
    for axis_formatter in (axes.xaxis.set_major_formatter, axes.xaxis.set_minor_formatter):
        axis_formatter(LogFormatter(minor_thresholds=(2, 0.5)))
    axes.grid(which="both")
    figure.draw_without_rendering()  # only then it is known where points and names are
    _name_points(axes, points)
    return figure


def _name_points(axes: Axes, points: Sequence[Point]) -> None:
    """Write names beside the points, with a line to a point that its name could not stay at."""
    across = [point.latency_ms_mean for point in points]
    upwards = [point.vote_accuracy for point in points]
    names = []
    for x, y, point in zip(across, upwards, points, strict=True):
        procedure = point.kind == PROCEDURE
        remark = ", chosen" if point.chosen else ", the choice" if procedure else ""
        # names that begin at one place are not moved apart, and the choice may lie on a system
        below = ScaledTranslation(0, -0.1 * procedure, axes.figure.dpi_scale_trans)
        left, low = axes.transData.inverted().transform((axes.transData + below).transform((x, y)))
        names.append(
            axes.text(
                left, low, f"{printable(point.system)}{remark}", fontsize=7, zorder=6,
                color="black" if point.on_frontier or procedure else DIM,
            )
        )  # fmt: skip
    adjust_text(
        names, across, upwards, ax=axes, expand=(1.1, 1.5), force_static=(0.5, 1), max_move=30,
        iter_lim=200, arrowprops={"arrowstyle": "-", "color": GUIDE, "linewidth": 0.6},
    )  # fmt: skip


def _by_latency(points: Sequence[Point]) -> list[Point]:
    return sorted(points, key=lambda item: (item.kind != PROCEDURE, item.latency_ms_mean))


def print_frontier(points: Sequence[Point], directory: Path, command: str) -> None:
    """Print the procedure, one line per system, quickest first, and how to train the chosen one."""
    figures = ["votes", "95 % CI", "picks", "ms", "fit s", "parameters"]
    table = make_table("frontier", ["system"], figures)
    table.caption = "picks: in how many folds it is chosen; ms: mean of one sample"
    for point in _by_latency(points):
        mark = " (chosen)" if point.chosen else ""
        table.add_row(
            f"{point.system}{mark}",
            f"{point.vote_accuracy:.1%}",
            f"{100 * point.ci_low:.1f}-{100 * point.ci_high:.1f}",
            "" if point.chosen_in_folds is None else str(point.chosen_in_folds),
            f"{point.latency_ms_mean:.1f}",
            f"{point.fit_seconds:.1f}",
            "" if point.parameters is None else f"{point.parameters:,}",
            style="bold" if point.kind == PROCEDURE else None if point.on_frontier else "dim",
        )
    print_table(table)
    if any(point.chosen for point in points):
        for remark in _remarks(points):
            say(remark)
        say(f"Train the chosen one with: {command}", wraps=False)
    print_tables(directory)


def _remarks(points: Sequence[Point]) -> Iterator[str]:
    """Yield what the accuracies of the choice and of the chosen system mean."""
    for point in points:
        if point.kind == PROCEDURE:
            yield (
                f"Expect {point.vote_accuracy:.1%} of such a choice ({point.system}): of each "
                "fold's votes by the system that was chosen on another fold."
            )
        if point.chosen:
            yield (
                f"{point.system} is chosen on all votes of the tested folds, so its own "
                f"{point.vote_accuracy:.1%} is optimistic. The choice holds for these classes; "
                "others may need a larger system."
            )
            if point.test_samples < MIN_SAMPLES:
                yield (
                    f"Fewer than {MIN_SAMPLES} samples were tested: the most accurate system is "
                    "chosen, as they cannot show that a quicker one suffices."
                )
