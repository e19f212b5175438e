"""Confusion matrices, and accuracy by class."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from tex_lightning.evaluation.outcomes import Counts, Shares
from tex_lightning.report.figures import draw_shares
from tex_lightning.report.style import brief, colour_of, styled

MAX_NAMED = 30  # classes up to which counts are written in
MAX_BARS = 25  # classes that have a bar
MAX_LABELLED = 150  # classes up to which each is named; the matrix of more is no larger
MAX_CHARACTERS = 26  # of a class name beside a row
GAMMA = 0.5  # power of the shares whose colours are seen among many that are zero
SMALL = 5.5  # points, of the names of many classes


@styled
def confusion_figure(counts: Counts, classes: list[str], title: str) -> Figure:
    """Draw a confusion matrix, rows normalised to 1.

    Counts are written in for up to 30 classes; up to 150 classes are named.
    """
    many = len(classes) > MAX_NAMED
    side = 4.5 + (0.1 * min(len(classes), MAX_LABELLED) if many else 0.28 * len(classes))
    figure = Figure(figsize=(side, side), layout="constrained")
    axes = figure.subplots()
    shares: Shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    cells = [] if many else np.argwhere(counts).tolist()
    texts = {(row, column): str(counts[row, column]) for row, column in cells}
    names = [brief(name, MAX_CHARACTERS) for name in classes]
    names = names if len(classes) <= MAX_LABELLED else []
    draw_shares(axes, shares, names, names, texts, "share of the true class", GAMMA if many else 1)
    if many:
        axes.tick_params(labelsize=SMALL, length=0, pad=1)
    axes.set(xlabel="predicted", ylabel="true", title=title)
    return figure


@styled
def class_accuracy_figure(counts: Counts, classes: list[str], name: str, title: str) -> Figure:
    """Draw the accuracy of every tested class as bars, the worst first; at most 25 of them.

    Args:
        counts: True class by predicted class.
        classes: Their names.
        name: Name of the network, in whose colour the bars are.
        title: Above them.
    """
    totals = counts.sum(axis=1)
    shares = np.diag(counts) / np.maximum(totals, 1)
    tested = np.flatnonzero(totals)
    shown = tested[np.argsort(shares[tested], kind="stable")][:MAX_BARS]
    wrong = counts - np.diag(np.diag(counts))
    figure = Figure(figsize=(7, 1.2 + 0.19 * len(shown)), layout="constrained")
    axes = figure.subplots()
    axes.barh(np.arange(len(shown)), shares[shown], color=colour_of(name))
    taken = [brief(classes[index], MAX_CHARACTERS) for index in wrong[shown].argmax(axis=1)]
    most = wrong[shown].max(axis=1)
    for row, (count, other) in enumerate(zip(most, taken, strict=True)):
        axes.annotate(
            f"{count} taken for {other}" if count else "", (1, row), (4, 0), va="center",
            fontsize=7, textcoords="offset points", annotation_clip=False,
        )  # fmt: skip
    names = [f"{brief(classes[index], MAX_CHARACTERS)} ({totals[index]})" for index in shown]
    axes.set_yticks(np.arange(len(shown)), names)
    axes.margins(y=0.02)
    axes.invert_yaxis()
    axes.xaxis.set_major_formatter(PercentFormatter(1))
    if len(shown) < len(tested):
        title += f"\nthe {MAX_BARS} worst of {len(tested)} classes"
    axes.set(xlim=(0, 1), xlabel="vote accuracy (number of samples in brackets)", title=title)
    return figure
