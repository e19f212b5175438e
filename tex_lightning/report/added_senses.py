"""Cost and repaired samples of each added sense: ``senses.csv``, and the marks of the chart."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log, sqrt
from pathlib import Path

from matplotlib.axes import Axes

from tex_lightning.core.console import say
from tex_lightning.core.files import write_lines

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
