"""Figures, drawn without a display."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from tex_lightning.core.files import write_atomically
from tex_lightning.evaluation.calibration import BINS, confidences, correct_votes
from tex_lightning.evaluation.confusion import Counts, recall_by_class, row_shares
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.report.style import GUIDE, brief, briefs, looks, styled

MAX_NAMED = 30  # classes up to which counts are written in
MAX_LABELLED = 150  # classes up to which each is named; the matrix of more is no larger
MAX_CHARACTERS = 26  # of a class name beside a row
MANY = 10_000  # from which a count is written in thousands
GAMMA = 0.5  # power of the shares whose colours are seen among many that are zero
SMALL = 5.5  # points, of the names of many classes


@styled
def save_figure(figure: Figure, path: Path) -> Path:
    """Save as PNG at a path without suffix, whole or not at all, and return the file.

    The figure is laid out once; loggers, which draw it again, find it so.

    Raises:
        UserError: If it cannot be written.
    """
    file = path.with_name(f"{path.name}.png")
    write_atomically(file, lambda partial: figure.savefig(partial, format="png"))
    figure.set_layout_engine("none")
    return file


@styled
def confusion_figure(counts: Counts, classes: list[str], title: str) -> Figure:
    """Draw a confusion matrix, rows normalised to 1.

    Counts are written in for up to 30 classes; up to 150 classes are named.
    """
    many = len(classes) > MAX_NAMED
    side = 4.5 + 0.1 * min(len(classes), MAX_LABELLED) if many else 4 + 0.16 * len(classes)
    figure = Figure(figsize=(side, 0.9 * side), layout="constrained")
    axes = figure.subplots()
    shares = row_shares(counts)
    gamma = GAMMA if many else 1
    image = axes.imshow(shares, norm=PowerNorm(gamma, 0, 1), cmap="viridis")
    names = briefs(classes, MAX_CHARACTERS)
    names = names if len(classes) <= MAX_LABELLED else []
    axes.set_xticks(range(len(names)), names, rotation=90)
    axes.set_yticks(range(len(names)), names)
    for row, column in [] if many else np.argwhere(counts).tolist():
        colour = "black" if shares[row, column] > 0.6 else "white"
        count = int(counts[row, column])
        cell = str(count) if count < MANY else f"{count / 1000:.0f}k"
        axes.text(column, row, cell, ha="center", va="center", fontsize=7, color=colour)
    bar = figure.colorbar(image, ax=axes, shrink=0.6, label="share of the true class")
    bar.ax.yaxis.set_major_formatter(PercentFormatter(1))
    if many:
        axes.tick_params(labelsize=SMALL, length=0, pad=1)
    axes.set(xlabel="predicted", ylabel="true", title=title)
    return figure


@styled
def recall_figure(counts: Counts, classes: list[str], title: str) -> Figure:
    """Draw the share of correct fragments of each class that was tested, the least one on top.

    Counts are of fragments by true class (row) and predicted class.
    """
    recall = recall_by_class(counts)
    ranked = np.argsort(recall, kind="stable")[::-1]
    order = [row for row in ranked.tolist() if np.isfinite(recall[row])]
    figure = Figure(figsize=(5, 1 + 0.16 * len(order)), layout="constrained")
    axes = figure.subplots()
    axes.barh(range(len(order)), recall[order], height=0.7)
    many = len(order) > MAX_NAMED
    named = briefs(classes, MAX_CHARACTERS)
    names = [named[row] for row in order]
    axes.set_yticks(range(len(order)), names, fontsize=SMALL if many else None)
    mean = counts.diagonal().sum() / max(1, counts.sum())
    axes.axvline(mean, color=GUIDE, linestyle="--")
    axes.set(xlim=(0, 1), ylim=(-0.6, len(order) - 0.4), title=title)
    axes.set_xlabel(f"share of correct fragments; of all classes together {mean:.1%}")
    axes.xaxis.set_major_formatter(PercentFormatter(1))
    return figure


@styled
def calibration_figure(outcomes: Sequence[Outcome], name: str) -> Figure:
    """Draw the reliability of a network's probabilities in 15 bins."""
    confidence, correct = confidences(outcomes), correct_votes(outcomes)
    figure = Figure(figsize=(3.5, 3.2), layout="constrained")
    axes = figure.subplots()
    edges = np.linspace(0, 1, BINS + 1)
    bins = np.clip(np.digitize(confidence, edges[1:-1], right=True), 0, BINS - 1)
    used = np.unique(bins)
    shares = [correct[bins == n].mean() for n in used]
    axes.plot([0, 1], [0, 1], color=GUIDE, linestyle="--")
    middles = (edges[used] + edges[used + 1]) / 2
    axes.bar(middles, shares, width=1 / BINS, edgecolor="white")
    axes.plot(middles, shares, "o", clip_on=False)  # a bar of height zero cannot be seen
    axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="probability of the label", ylabel="accuracy")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(PercentFormatter(1))
    axes.set_title(f"{name}: {len(outcomes)} test samples")
    return figure


@styled
def learning_figure(curves: Mapping[str, Sequence[Mapping[str, float]]]) -> Figure:
    """Draw the loss of all networks over their epochs, and the accuracy of any validation below.

    Curves are by network rows with ``epoch`` and some of ``train/loss``, ``val/loss``,
    ``val/vote_accuracy``.
    """
    validated = any("val/vote_accuracy" in row for rows in curves.values() for row in rows)
    figure = Figure(figsize=(5.2, 4.2 if validated else 2.4), layout="constrained")
    grid = figure.subplots(1 + validated, 1, sharex=True, squeeze=False)
    upper, lower = grid[0, 0], grid[-1, 0]
    for (name, rows), look in zip(curves.items(), looks(curves).values(), strict=True):
        for axes, key, line in (
            (upper, "train/loss", ":"), (upper, "val/loss", "-"), (lower, "val/vote_accuracy", "-"),
        ):  # fmt: skip
            points = [(row["epoch"] + 1, row[key]) for row in rows if key in row]
            if points:
                label = f"{brief(name)}, {key.replace('/', ' ').replace('_', ' ')}"
                axes.plot(*zip(*points, strict=True), line, color=look.colour, label=label)
    if validated:
        lower.set(ylabel="accuracy", ylim=(-0.03, 1.03))
        lower.yaxis.set_major_formatter(PercentFormatter(1))
    upper.set(ylabel="loss", title="learning curves")
    lower.set_xlabel("epoch")
    lower.xaxis.set_major_locator(MaxNLocator(integer=True))
    for axes in figure.axes:
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=6)
    return figure
