"""The picture of the field: accuracy against the time for a label, a panel for each data set."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from sklearn.isotonic import isotonic_regression

from tex_lightning.report.figures import save_figure
from tex_lightning.report.style import COLOURS, GUIDE, styled

OURS, BEST, PEER = COLOURS[4], "#222222", "#8a8a8a"
GAP = 0.095  # of the height of a panel, between names
COLUMNS = 4
TICKS = {1: "1", 10: "10", 100: "100", 1000: "1 s"}
Array = np.ndarray[Any, Any]
Node = dict[str, Any]


@styled
def draw(settings: Node, results: Sequence[Node], path: Path) -> None:
    """Draw the panels of ``field`` that have results; those of one name are variants of a system.

    Args:
        settings: The table: ``field`` lists data, protocol and title; ``names`` has the systems
            that are drawn, and ``ours`` those names that are the package's.
        results: Of all cells.
        path: Of the picture, without suffix.
    """
    drawn = settings.get("field", [])
    found_of = [named(settings, panel["data"], panel["protocol"], results) for panel in drawn]
    panels = [pair for pair in zip(drawn, found_of, strict=True) if pair[1]]
    if not panels:
        return
    figure, grid = make_grid(len(panels), (2.9, 2.15))
    for number, (axes, (panel, found)) in enumerate(zip(grid, panels, strict=True)):
        draw_panel(axes, found, settings["ours"])
        axes.set_title(panel["title"], loc="left", fontsize=7.5)
        if number % COLUMNS == 0:
            axes.set_ylabel("accuracy (%)", labelpad=1)
        if number >= len(panels) - COLUMNS:
            axes.set_xlabel("ms for one label", labelpad=1)
    save_figure(figure, path)


def make_grid(count: int, size: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    """A figure of ``count`` panels of a ``size`` in inches, at most ``COLUMNS`` in a row."""
    columns = min(count, COLUMNS)
    rows = -(-count // columns)
    figure = Figure(figsize=(size[0] * columns, size[1] * rows), layout="constrained")
    grid = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axes in grid[count:]:
        axes.set_axis_off()
    return figure, grid[:count]


def named(settings: Node, data: str, protocol: str, results: Sequence[Node]) -> list[Node]:
    """Return the best variant of each named system in one test, the most accurate first."""
    best: dict[str, Node] = {}
    for result in results:
        name = settings.get("names", {}).get(result["system"])
        here = (result["data"], result["protocol"]) == (data, protocol)
        if here and name and result["score"] > best.get(name, {"score": -1})["score"]:
            best[name] = {**result, "name": name}
    return sorted(best.values(), key=lambda result: -result["score"])


def best_peers(settings: Node, results: Sequence[Node]) -> dict[str, Node]:
    """Return the result of the best system of each test that is not the package's, by its name."""
    best = {}
    for data, protocol in dict.fromkeys((each["data"], each["protocol"]) for each in results):
        found = named(settings, data, protocol, results)
        peers = [result for result in found if result["name"] not in settings["ours"]]
        best |= {f"best peer of {data}.{protocol}": result for result in peers[:1]}
    return best


def draw_panel(axes: Axes, found: Sequence[Node], ours: Sequence[str]) -> None:
    """Draw systems with their intervals, and their names in a column on the right."""
    scores = np.array([100 * result["score"] for result in found])
    low = min(100 * result["ci_low"] for result in found)
    bottom, top = low - 0.04 * (100 - low), 100 + 0.04 * (100 - low)
    axes.set(xscale="log", xlim=(0.2, 10_000), ylim=(bottom, top))
    axes.set_xticks([*TICKS], [*TICKS.values()])
    axes.minorticks_off()
    axes.grid(axis="y")
    places = spread((scores - bottom) / (top - bottom), GAP)
    best = next((result for result in found if result["name"] not in ours), None)
    for result, score, place in zip(found, scores, places, strict=True):
        mine = result["name"] in ours
        colour = OURS if mine else BEST if result is best else PEER
        at, ends = result["latency_ms"], (100 * result["ci_low"], 100 * result["ci_high"])
        interval = [[max(0.0, score - ends[0])], [max(0.0, ends[1] - score)]]
        strong = mine or result is best
        width, order = (1.2, 3) if strong else (0.6, 2)
        axes.errorbar(
            at, score, interval, fmt="o" if mine else "D" if strong else ".", color=colour,
            markersize=6 if mine else 4, elinewidth=width, zorder=order,
        )  # fmt: skip
        line = {"arrowstyle": "-", "color": GUIDE, "linewidth": 0.35, "shrinkA": 0, "shrinkB": 2}
        axes.annotate(
            f"{result['name']}  {score:.1f}", (at, score), (1.07, place), va="center",
            textcoords="axes fraction", color=colour, fontsize=6.5, annotation_clip=False,
            fontweight="bold" if strong else "normal", arrowprops=line,
        )  # fmt: skip


def spread(falling: Array, gap: float) -> Array:
    """Return falling places in 0 to 1, moved as little as keeps each ``gap`` from the next."""
    steps = gap * np.arange(len(falling))
    places = isotonic_regression(falling + steps, increasing=False) - steps
    moved: Array = np.clip(places, steps[::-1], 1 - steps)
    return moved
