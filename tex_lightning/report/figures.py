"""Figures, drawn without a display and closed by whoever saves them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor, nn

from tex_lightning.evaluation.fragments import Counts
from tex_lightning.features.image import MEAN, STD
from tex_lightning.features.spectrogram import SpectrogramFeatures
from tex_lightning.files import write_atomically


def confusion_figure(counts: Counts, classes: list[str], title: str) -> Figure:
    """Confusion matrix, rows normalised to 1; counts are written in where they are legible."""
    size = min(4.5 + 0.28 * len(classes), 22)
    figure = Figure(figsize=(size, size), layout="constrained")
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    shown = np.argwhere(counts).tolist() if len(classes) <= 30 else []
    texts = {(row, column): str(counts[row, column]) for row, column in shown}
    axes = draw_shares(figure, shares, classes, classes, texts, "share of the true class")
    axes.set(xlabel="predicted", ylabel="true", title=title)
    return figure


def draw_shares(
    figure: Figure,
    shares: npt.NDArray[np.float64],
    rows: Sequence[str],
    columns: Sequence[str],
    texts: Mapping[tuple[int, int], str],
    label: str,
) -> Axes:
    """Colours for a table of shares from 0 to 1 (rows, columns), and texts in some of its cells."""
    axes = figure.subplots()
    image = axes.imshow(shares, vmin=0, vmax=1, cmap="viridis", aspect="auto")
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
    axes.set_yticks(range(len(rows)), rows, fontsize=7)
    for (row, column), text in texts.items():
        colour = "black" if shares[row, column] > 0.6 else "white"
        axes.text(column, row, text, ha="center", va="center", fontsize=7, color=colour)
    figure.colorbar(image, ax=axes, shrink=0.6, label=label)
    return axes


def class_accuracy_figure(
    counts: Counts, classes: list[str], title: str, what: str = "vote"
) -> Figure:
    """Accuracy of every class as bars, of votes or fragments."""
    figure = Figure(figsize=(7, min(2.0 + 0.22 * len(classes), 16)), layout="constrained")
    axes = figure.subplots()
    totals = counts.sum(axis=1)
    axes.barh(np.arange(len(classes)), np.diag(counts) / np.maximum(totals, 1), color="#4477aa")
    names = [f"{name} ({total})" for name, total in zip(classes, totals, strict=True)]
    axes.set_yticks(np.arange(len(classes)), names, fontsize=7)
    axes.invert_yaxis()
    axes.set(xlim=(0, 1), xlabel=f"{what} accuracy (number in brackets)", title=title)
    return figure


def spectrogram_figure(spectrograms: Tensor, titles: list[str], features: nn.Module) -> Figure:
    """Network inputs (count, bands, frames) of signals side by side."""
    figure, grid = make_grid(len(titles), 4, (3, 2.4))
    for axes, spectrogram, title in zip(grid, spectrograms, titles, strict=True):
        across, upwards = draw_spectrogram(axes, spectrogram, features)
        axes.set_title(title, fontsize=7)
        axes.set(xlabel=across, ylabel=upwards)
    return figure


def draw_spectrogram(axes: Axes, spectrogram: Tensor, features: nn.Module) -> tuple[str, str]:
    """A network input (bands, frames) of a signal.

    Returns:
        What both axes count: seconds and Hz with every tenth band's frequency, or, of features that
        tell neither, frames and bands.
    """
    bands, frames = spectrogram.shape
    image = axes.imshow(spectrogram.numpy(), origin="lower", aspect="auto", cmap="magma")
    if not isinstance(features, SpectrogramFeatures):
        return "frame", "band"
    seconds = frames * features.hop_length / features.sampling_rate
    image.set_extent((0, seconds, -0.5, bands - 0.5))
    hertz = features.frequencies[::10]
    axes.set_yticks(range(0, bands, 10), [f"{frequency:.0f}" for frequency in hertz])
    return "s", "Hz"


def patch_figure(patches: Tensor, titles: list[str]) -> Figure:
    """Normalised patches (count, 3, height, width) side by side, in their own colours."""
    figure, grid = make_grid(len(titles), 4, (3, 2.4))
    pixels = patches.permute(0, 2, 3, 1).numpy() * np.array(STD) + np.array(MEAN)
    for axes, patch, title in zip(grid, pixels.clip(0, 1), titles, strict=True):
        axes.imshow(patch)
        axes.set_title(title, fontsize=7)
        axes.set_axis_off()
    return figure


def save_figure(figure: Figure, path: Path) -> None:
    """Save as PNG, making the folder."""
    write_atomically(path, lambda partial: figure.savefig(partial, format="png", dpi=120))


def make_grid(
    count: int, most: int, size: tuple[float, float], *, sharey: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure of ``count`` charts of a ``size`` in inches, at ``most`` so many in a row."""
    columns = min(count, most)
    rows = -(-count // columns)
    figure = Figure(figsize=(size[0] * columns, size[1] * rows), layout="constrained")
    grid = list(figure.subplots(rows, columns, squeeze=False, sharey=sharey).ravel())
    for axes in grid[count:]:
        axes.set_axis_off()
    return figure, grid[:count]
