"""Confusion matrices, and accuracy by class."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from tex_lightning.evaluation.outcomes import Counts, Shares
from tex_lightning.report.figures import draw_shares
from tex_lightning.report.style import brief, colour_of, styled

MAX_NAMED = 30  # classes up to which counts are written in, and bars show every class
MAX_WORST = 25  # classes that are shown of more
MAX_LABELLED = 150  # classes up to which each is named; the matrix of more is no larger
MAX_CHARACTERS = 26  # of a class name beside a row
GAMMA = 0.5  # power of the shares whose colours are seen among many that are zero
ROW = 0.1  # inches of one class of many
SMALL = 5.5  # points, of the names of many classes


@styled
def confusion_figure(counts: Counts, classes: list[str], title: str) -> Figure:
    """Draw a confusion matrix, rows normalised to 1.

    Counts are written in for up to 30 classes; up to 150 classes are named.
    """
    many = len(classes) > MAX_NAMED
    side = 4.5 + (ROW * min(len(classes), MAX_LABELLED) if many else 0.28 * len(classes))
    figure = Figure(figsize=(side, side), layout="constrained")
    axes = figure.subplots()
    shares: Shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    cells = [] if many else np.argwhere(counts).tolist()
    texts = {(row, column): str(counts[row, column]) for row, column in cells}
    names = [brief(name, MAX_CHARACTERS) for name in classes] if many else classes
    names = names if len(classes) <= MAX_LABELLED else []
    draw_shares(axes, shares, names, names, texts, "share of the true class", GAMMA if many else 1)
    if many:
        axes.tick_params(labelsize=SMALL, length=0, pad=1)
    axes.set(xlabel="predicted", ylabel="true", title=title)
    return figure


@styled
def class_accuracy_figure(
    counts: Counts, classes: list[str], name: str, title: str, what: str = "vote"
) -> Figure:
    """Draw the accuracy of every class as bars; of more than 30 classes the worst 25.

    Args:
        counts: True class by predicted class.
        classes: Their names.
        name: Name of the network, in whose colour the bars are.
        title: Above them.
        what: What is counted, ``vote`` or ``fragment``.
    """
    totals = counts.sum(axis=1)
    shares = np.diag(counts) / np.maximum(totals, 1)
    shown = np.arange(len(classes))
    if len(classes) > MAX_NAMED:
        shown, note = _worst(shares, totals)
        title += f"\n{note}"
    figure = Figure(figsize=(7, 1.2 + 0.19 * len(shown)), layout="constrained")
    axes = figure.subplots()
    axes.barh(np.arange(len(shown)), shares[shown], color=colour_of(name))
    names = [f"{brief(classes[index], MAX_CHARACTERS)} ({totals[index]})" for index in shown]
    axes.set_yticks(np.arange(len(shown)), names)
    axes.margins(y=0.02)
    axes.invert_yaxis()
    axes.xaxis.set_major_formatter(PercentFormatter(1))
    if len(classes) > MAX_NAMED:
        _name_mistakes(axes, counts, shown.tolist(), classes)
    axes.set(xlim=(0, 1), xlabel=f"{what} accuracy (number of {what}s in brackets)", title=title)
    return figure


def _worst(shares: Shares, totals: Counts) -> tuple[npt.NDArray[np.intp], str]:
    """Return indices of the tested classes of the lowest shares, and a note on the others."""
    tested = np.flatnonzero(totals)
    shown = tested[np.argsort(shares[tested], kind="stable")][:MAX_WORST]
    rest = len(tested) - len(shown)
    those = f"{len(tested)} classes" + " that were tested" * (len(tested) < len(totals))
    if not rest:
        return shown, f"the {those}"
    least = f"{shares[shown[-1]]:.0%}"
    return shown, f"the {MAX_WORST} worst of {those}; the other {rest} reach at least {least}"


def _name_mistakes(axes: Axes, counts: Counts, shown: Sequence[int], classes: list[str]) -> None:
    """Write to the right of every bar what the class is taken for most often."""
    wrong = counts - np.diag(np.diag(counts))
    for place, index in enumerate(shown):
        if count := int(wrong[index].max()):
            name = brief(classes[int(wrong[index].argmax())], MAX_CHARACTERS)
            axes.annotate(
                f"{count} taken for {name}", (1, place), (4, 0), va="center", fontsize=7,
                textcoords="offset points", annotation_clip=False,
            )  # fmt: skip
