"""How accuracy grows with the recordings of a class that a system is trained on."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib.ticker
from matplotlib.figure import Figure

from tex_lightning.core.files import write_rows
from tex_lightning.evaluation.outcomes import wilson_interval
from tex_lightning.report.labels import name_lines
from tex_lightning.report.numbers import spread
from tex_lightning.report.style import looks, styled
from tex_lightning.report.systems import PER_CLASS, System

HEIGHT = 4.2  # inches
COLUMNS = ("system", "per_class", "correct", "test_samples", "vote_accuracy", "ci_low", "ci_high")


class Point(NamedTuple):
    """Votes of a system that was trained on so many recordings of each class."""

    per_class: int
    correct: int
    test_samples: int

    @property
    def accuracy(self) -> float:
        """Share of correct votes."""
        return self.correct / self.test_samples

    @property
    def interval(self) -> list[float]:
        """Wilson's 95 % interval of the share."""
        return wilson_interval(self.correct, self.test_samples)


def learning_curves(systems: Sequence[System]) -> dict[str, list[Point]]:
    """Points by system, in the order of their recordings; of systems with two or more."""
    curves: dict[str, list[Point]] = {}
    for system in systems:
        items = system.variant.split(", ")
        given = [item for item in items if item.startswith(PER_CLASS)]
        if system.inside or not given or not given[-1].removeprefix(PER_CLASS).isdecimal():
            continue
        others = [item for item in items if item and item not in given]
        hits = [outcome.label == outcome.predicted for outcome in system.outcomes]
        point = Point(int(given[-1].removeprefix(PER_CLASS)), sum(hits), len(hits))
        curves.setdefault(" ".join([system.model, *others]), []).append(point)
    return {name: sorted(points) for name, points in curves.items() if len(points) > 1}


@styled
def learning_figure(curves: Mapping[str, Sequence[Point]]) -> Figure:
    """Draw a line with intervals for every system, over a logarithmic axis of recordings."""
    figure = Figure(figsize=(7, HEIGHT), layout="constrained")
    axes = figure.subplots()
    drawn = looks(curves)
    for place, (name, points) in enumerate(curves.items()):
        shift = 1.02 ** (place - (len(curves) - 1) / 2)  # so that intervals do not hide each other
        bounds = [
            [point.accuracy - point.interval[0] for point in points],
            [point.interval[1] - point.accuracy for point in points],
        ]
        counts = [point.per_class * shift for point in points]
        accuracies = [point.accuracy for point in points]
        look = drawn[name]
        axes.errorbar(counts, accuracies, bounds, marker=look.marker, color=look.colour, capsize=3)
    ticks = sorted({point.per_class for points in curves.values() for point in points})
    axes.set_xscale("log")
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.xaxis.set_minor_locator(matplotlib.ticker.NullLocator())
    axes.yaxis.set_major_formatter(matplotlib.ticker.PercentFormatter(1))
    tested = spread(
        [point.test_samples for points in curves.values() for point in points], "test samples", "d"
    )
    axes.set(
        xlabel="recordings of each class trained on",
        ylabel="correct votes with Wilson's 95 % interval",
        title=tested,
    )
    axes.grid(axis="y")
    ends = [(name, points[-1].accuracy, drawn[name]) for name, points in curves.items()]
    name_lines(axes, ends, HEIGHT)
    return figure


def write_curves(curves: Mapping[str, Sequence[Point]], path: Path) -> None:
    """Write the points as CSV with the columns ``COLUMNS``."""
    rows = [
        [name, *point, point.accuracy, *point.interval]
        for name, points in curves.items()
        for point in points
    ]
    write_rows(path, COLUMNS, rows)
