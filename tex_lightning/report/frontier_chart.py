"""Table and chart of ``task=frontier``."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import log, sqrt
from pathlib import Path

from adjustText import adjust_text
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogFormatter
from matplotlib.transforms import Bbox

from tex_lightning.core.console import say
from tex_lightning.core.files import write_lines
from tex_lightning.evaluation.comparison import MIN_SAMPLES
from tex_lightning.report.style import GUIDE, looks, styled
from tex_lightning.report.table import make_table, paper_table, print_table, print_tables
from tex_lightning.text import printable

ROW = 0.06  # height of a label, as a share of the axes
COLOUR = "#cc3311"


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
        """Its text in the chart."""
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


def mark_added_senses(
    axes: Axes, steps: Sequence[AddedSense], places: Mapping[str, tuple[float, float]]
) -> None:
    """Draw arrows from system to system, and what each adds in a row of its own under the points.

    Args:
        axes: With all points on it, logarithmic in latency.
        steps: What is marked, at most a handful.
        places: Of each system, latency and accuracy.
    """
    if not steps:
        return
    low, high = axes.get_ylim()
    rows = ROW * (len(steps) + 0.5)
    axes.set_yticks([tick for tick in axes.get_yticks() if low <= tick <= min(high, 1)])
    axes.set_ylim(low - (high - low) * rows / (1 - rows), high)  # room for the labels
    left, right = map(log, axes.get_xlim())
    for number, step in enumerate(reversed(steps)):
        begin, end = places[step.before], places[step.after]
        axes.annotate(
            "", xy=end, xytext=begin, zorder=4,
            arrowprops={"arrowstyle": "->", "color": COLOUR, "shrinkA": 6, "shrinkB": 6},
        )  # fmt: skip
        middle = sqrt(begin[0] * end[0]), (begin[1] + end[1]) / 2
        across = (log(middle[0]) - left) / (right - left)
        axes.annotate(
            step.label, xy=middle, xytext=(min(max(across, 0.22), 0.78), ROW * (number + 0.6)),
            textcoords="axes fraction", ha="center", va="center", fontsize=7, color=COLOUR,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1}, zorder=6,
            arrowprops={"arrowstyle": "-", "color": COLOUR, "linewidth": 0.8, "linestyle": ":"},
        )  # fmt: skip


PROCEDURE = "procedure"  # kind of the point that measures the choice
DIM = "#555555"  # names of dominated systems


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
def frontier_figure(points: Sequence[Point], steps: Sequence[AddedSense] = ()) -> Figure:
    """Accuracy with intervals over latency (log axis); dominated systems are hollow.

    The procedure that chooses is a hollow diamond. Every point has its name beside it, moved to
    where it covers neither points nor other names. Senses that are added one after another are
    arrows, with what they cost and repair.
    """
    figure = Figure(figsize=(11, 7), layout="constrained")
    axes = figure.subplots()
    colours = _colours(points)
    for point in _by_latency(points):
        colour, procedure = colours[point.system], point.kind == PROCEDURE
        low, high = point.vote_accuracy - point.ci_low, point.ci_high - point.vote_accuracy
        axes.errorbar(
            point.latency_ms_mean, point.vote_accuracy, yerr=[[max(low, 0)], [max(high, 0)]],
            color=colour, elinewidth=0.8, capsize=2,
        )  # fmt: skip
        axes.scatter(
            point.latency_ms_mean, point.vote_accuracy, s=_area(point),
            zorder=5 if procedure else 3,
            facecolors=colour if point.on_frontier else "white", marker="D" if procedure else "o",
            edgecolors="black" if point.chosen else colour, linewidths=1.5 if point.chosen else 1,
        )  # fmt: skip
    line = _line(points)
    axes.plot([item.latency_ms_mean for item in line], [item.vote_accuracy for item in line],
              color="black", linewidth=0.8, linestyle="--", drawstyle="steps-post")  # fmt: skip
    counts = sorted({point.test_samples for point in points if point.kind != PROCEDURE})
    axes.set(
        xscale="log",
        xlabel=f"ms for one sample, features included (mean over samples)\n{_ratios()}",
        ylabel="vote accuracy with Wilson's 95 % interval",
        title=f"Accuracy against latency, {' or '.join(map(str, counts))} test samples\n"
        "diamond: what to expect of the choice, each fold's votes by the system chosen on another "
        "fold;\nblack edge: the system chosen on all of these votes, and so optimistic; area grows "
        "with parameters; hollow: dominated",
    )
    axes.margins(x=0.15, y=0.15)  # room for names
    axes.yaxis.set_major_formatter(lambda share, _: f"{100 * share:.4g}%" if share <= 1 else "")
    for formatter in (axes.xaxis.set_major_formatter, axes.xaxis.set_minor_formatter):
        formatter(LogFormatter(minor_thresholds=(2, 0.5)))
    axes.tick_params(axis="x", which="both", length=2)  # else their labels lie at two heights
    axes.grid(which="both")
    places = {item.system: (item.latency_ms_mean, item.vote_accuracy) for item in points}
    mark_added_senses(axes, steps, places)
    figure.draw_without_rendering()  # only then it is known where points and names are
    _name_points(axes, points)
    return figure


def _name_points(axes: Axes, points: Sequence[Point]) -> None:
    """Names beside the points, with a line to a point that its name could not stay at."""
    across = [point.latency_ms_mean for point in points]
    upwards = [point.vote_accuracy for point in points]
    halo = [withStroke(linewidth=2, foreground="white")]
    names = []
    for x, y, point in zip(across, upwards, points, strict=True):
        # the choice may lie where a system does; names that begin at one place are not moved apart
        drop = 10 if point.kind == PROCEDURE else 0
        place = axes.transData.transform((x, y)) - (0, drop)
        left, low = axes.transData.inverted().transform(place).tolist()
        text = axes.text(left, low, _entry(point))
        text.set(fontsize=7, zorder=6, color=_ink(point), path_effects=halo)
        names.append(text)
    adjust_text(
        names, across, upwards, objects=[_disc(axes, point) for point in points], ax=axes,
        expand=(1.1, 1.5), force_static=(0.5, 1), max_move=30, iter_lim=200,
        arrowprops={"arrowstyle": "-", "color": GUIDE, "linewidth": 0.6},
    )  # fmt: skip


def _by_latency(points: Sequence[Point]) -> list[Point]:
    return sorted(points, key=lambda item: (item.kind != PROCEDURE, item.latency_ms_mean))


def _disc(axes: Axes, point: Point) -> Bbox:
    """What a point covers, in pixels."""
    place = axes.transData.transform((point.latency_ms_mean, point.vote_accuracy))
    radius = sqrt(_area(point)) / 2 * axes.figure.dpi / 72
    return Bbox([place - radius, place + radius])


def _entry(point: Point) -> str:
    remark = ", chosen" if point.chosen else ", the choice" if point.kind == PROCEDURE else ""
    return f"{printable(point.system)}{remark}"


def _ink(point: Point) -> str:
    return "black" if point.on_frontier or point.kind == PROCEDURE else DIM


def _colours(points: Sequence[Point]) -> dict[str, str]:
    """Colours by name, the same in every chart; the choice, which is no system, is black."""
    systems = [point.system for point in points if point.kind != PROCEDURE]
    found = {name: look.colour for name, look in looks(systems).items()}
    return {point.system: found.get(point.system, "black") for point in points}


def _line(points: Sequence[Point]) -> list[Point]:
    kept = [point for point in points if point.on_frontier]
    return sorted(kept, key=lambda item: (item.latency_ms_mean, item.vote_accuracy))


def _area(point: Point) -> float:
    area: float = 12 + 10 * (max(point.parameters or 0, 1000) / 1000) ** 0.4
    return area


def _ratios() -> str:
    timed = {kind: row for kind, row in paper_table("profiling").items() if isinstance(row, dict)}
    ratios = (
        f"{kind} {row['sliding_window_ms'] / row['fcn_ms']:.1f}x" for kind, row in timed.items()
    )
    return f"the paper's gain of dense over sliding windows: {', '.join(ratios)}"


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
    for chosen in (point for point in points if point.chosen):
        for line in _remarks(chosen, points):
            say(line)
        say(f"Train the chosen one with: {command}", wraps=False)
    print_tables(directory)


def _remarks(chosen: Point, points: Sequence[Point]) -> Iterator[str]:
    """Remarks on the accuracies of the choice and of the chosen system."""
    for point in points:
        if point.kind == PROCEDURE:
            yield (
                f"Expect {point.vote_accuracy:.1%} of such a choice ({point.system}): of each "
                "fold's votes by the system that was chosen on another fold."
            )
    yield (
        f"{chosen.system} is chosen on all votes of the tested folds, so its own "
        f"{chosen.vote_accuracy:.1%} is optimistic. The choice holds for these classes; others may "
        "need a larger system."
    )
    if chosen.test_samples < MIN_SAMPLES:
        yield (
            f"Fewer than {MIN_SAMPLES} samples were tested: the most accurate system is chosen, as "
            "they cannot show that a quicker one suffices."
        )
