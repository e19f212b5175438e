"""Confusion matrices, and accuracy by class."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import PercentFormatter

from tex_lightning.evaluation.fragments import Counts, Shares
from tex_lightning.report.categories import categories
from tex_lightning.report.figures import draw_shares
from tex_lightning.report.labels import brief, spaced
from tex_lightning.report.style import colour_of, styled

NAMED = 30  # classes up to which a matrix names both of its sides, and bars show every class
WORST = 25  # classes that are shown of more
LONGEST = 26  # characters of a class name beside a row
PAD = 0.15  # inches beside a matrix; the layout falls some 0.05 short of its long names
GAMMA = 0.5  # power of the shares whose colours are seen among many that are zero
ROW = 0.1  # inches of one class of many
NAMES = 150  # classes up to which each is named; the matrix of more is no larger
CELL = 0.42  # inches of a category
SIZE, NAME = 5.5, 7  # points, of the names of many classes and of categories
LARGE = 72  # classes from which on the names of categories grow
LETTER = 0.06  # inches of one of these


@styled
def confusion_figure(counts: Counts, classes: list[str], title: str) -> Figure:
    """Confusion matrix, rows normalised to 1; counts are written in where they are legible.

    Of more than 30 classes these stand in the order of their categories, whose confusion with each
    other is drawn beside them (:func:`~tex_lightning.report.categories.categories`); up to 150
    classes are named.
    """
    if len(classes) > NAMED:
        return _grouped_confusion(counts, classes, title)
    size = 4.5 + 0.28 * len(classes)
    figure = Figure(figsize=(size, size), layout="constrained")
    axes = figure.subplots()
    _draw_counts(axes, counts, classes)
    axes.set(xlabel="predicted", ylabel="true", title=title)
    return figure


def _draw_counts(axes: Axes, counts: Counts, names: Sequence[str], gamma: float = 1) -> None:
    """Shares of the rows as colours, with their counts."""
    places = np.argwhere(counts).tolist()
    texts = {(row, column): str(counts[row, column]) for row, column in places}
    draw_shares(axes, _shares(counts), names, names, texts, "share of the true class", gamma)


def _shares(counts: Counts) -> Shares:
    shares: Shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    return shares


def _grouped_confusion(counts: Counts, classes: Sequence[str], title: str) -> Figure:
    """Classes in the order of their categories, and beside them the categories."""
    groups = categories(counts, classes)
    order = [index for members in groups.values() for index in members]
    starts = np.cumsum([0, *map(len, groups.values())])
    ordered = counts[np.ix_(order, order)]
    pooled = np.add.reduceat(np.add.reduceat(ordered, starts[:-1], axis=0), starts[:-1], axis=1)
    rows = min(len(classes), NAMES)
    scale = max(1, rows / LARGE)  # what is read at a glance grows with the figure
    wide, narrow = ROW * rows, max(CELL * scale * len(groups), 3)
    words = LETTER * scale * max(map(len, groups))
    size = (wide + narrow + LETTER * LONGEST + 2 * words + 2.6, wide + words + 1)
    figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=PAD))
    left, right = figure.subplots(1, 2, width_ratios=(wide, narrow))
    names = [brief(classes[index], LONGEST) for index in order if len(order) == rows]
    draw_shares(left, _shares(ordered), names, names, {}, None, GAMMA)
    left.tick_params(axis="y", labelsize=SIZE, length=0, pad=1)
    _mark_categories(left, list(groups), starts - 0.5, NAME * scale, wide / len(classes))
    left.set(xlabel="predicted", ylabel="true", title=f"{len(classes)} classes")
    _draw_counts(right, pooled, list(groups), GAMMA)
    right.tick_params(labelsize=NAME * scale)
    right.set(xlabel="predicted", ylabel="true", title=f"{len(groups)} categories")
    for axes in (left, right):
        axes.set(aspect="equal", anchor="N")
    figure.suptitle(title)
    return figure


def _mark_categories(
    axes: Axes, names: Sequence[str], edges: npt.NDArray[np.float64], size: float, row: float
) -> None:
    """Lines between the categories of a matrix, and their names below and to the right.

    The ``size`` of the names is in points, that of a ``row`` in inches.
    """
    for edge in edges[1:-1]:
        axes.axhline(edge, color="white", linewidth=0.4)
        axes.axvline(edge, color="white", linewidth=0.4)
    middles = ((edges[1:] + edges[:-1]) / 2).tolist()
    gap = 1.3 * size / 72 / row
    places = spaced(middles, gap, edges[0] + gap / 2, edges[-1] - gap / 2)
    axes.set_xticks(places, names, fontsize=size, rotation=90)
    beside = axes.secondary_yaxis("right")
    beside.set_yticks(places, names, fontsize=size)
    for axis in (axes.xaxis, beside.yaxis):
        axis.set_tick_params(length=0)


@styled
def class_accuracy_figure(
    counts: Counts, classes: list[str], name: str, title: str, what: str = "vote"
) -> Figure:
    """Accuracy of every class as bars, of votes or fragments; of many classes the worst ones.

    Args:
        counts: True class by predicted class.
        classes: Their names.
        name: Name of the network, in whose colour the bars are.
        title: Above them.
        what: What is counted.
    """
    totals = counts.sum(axis=1)
    shares = np.diag(counts) / np.maximum(totals, 1)
    shown, note = np.arange(len(classes)), ""
    if len(classes) > NAMED:
        shown, note = _worst(shares, totals)
        title += f"\n{note}"
    figure = Figure(figsize=(7, 1.2 + 0.19 * len(shown)), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(shown))
    axes.barh(places, shares[shown], color=colour_of(name))
    names = [f"{brief(classes[index], LONGEST)} ({totals[index]})" for index in shown]
    axes.set_yticks(places, names)
    axes.margins(y=0.02)
    axes.invert_yaxis()
    axes.xaxis.set_major_formatter(PercentFormatter(1))
    if note:
        _say_mistakes(axes, counts[shown], shown.tolist(), classes)
    axes.set(xlim=(0, 1), xlabel=f"{what} accuracy (number of {what}s in brackets)", title=title)
    return figure


def _worst(shares: Shares, totals: Counts) -> tuple[npt.NDArray[np.intp], str]:
    """Indices of the classes of the lowest shares, among those that were tested, and a note."""
    tested = np.flatnonzero(totals)
    shown = tested[np.argsort(shares[tested], kind="stable")][:WORST]
    rest = len(tested) - len(shown)
    those = f"{len(tested)} classes" + " that were tested" * (len(tested) < len(totals))
    if not rest:
        return shown, f"the {those}"
    note = f"the {WORST} worst of {those}; the other {rest} reach at least {shares[shown[-1]]:.0%}"
    return shown, note


def _say_mistakes(axes: Axes, rows: Counts, shown: Sequence[int], classes: Sequence[str]) -> None:
    """To the right of every bar what the class is taken for most often, where it is."""
    for place, (row, own) in enumerate(zip(rows, shown, strict=True)):
        wrong = row.copy()
        wrong[own] = 0
        if count := int(wrong.max()):
            name = brief(classes[int(wrong.argmax())], LONGEST)
            axes.annotate(
                f"{count} taken for {name}", (1, place), (4, 0), va="center", fontsize=NAME,
                textcoords="offset points", annotation_clip=False,
            )  # fmt: skip
