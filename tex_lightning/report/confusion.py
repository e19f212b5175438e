"""Confusion matrices."""

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from tex_lightning.evaluation.outcomes import Counts
from tex_lightning.report.figures import draw_shares
from tex_lightning.report.style import brief, styled

MAX_NAMED = 30  # classes up to which counts are written in
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
    shares: npt.NDArray[np.float64] = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    cells = [] if many else np.argwhere(counts).tolist()
    texts = {(row, column): str(counts[row, column]) for row, column in cells}
    names = [brief(name, MAX_CHARACTERS) for name in classes]
    names = names if len(classes) <= MAX_LABELLED else []
    draw_shares(axes, shares, names, names, texts, "share of the true class", GAMMA if many else 1)
    if many:
        axes.tick_params(labelsize=SMALL, length=0, pad=1)
    axes.set(xlabel="predicted", ylabel="true", title=title)
    return figure
