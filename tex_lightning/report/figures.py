"""Figures, drawn without a display and closed by whoever saves them."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor, nn

from tex_lightning.evaluation.fragments import Counts
from tex_lightning.features.image import MEAN, STD
from tex_lightning.features.spectrogram import SpectrogramFeatures


def confusion_figure(counts: Counts, classes: list[str], title: str) -> Figure:
    """Confusion matrix, rows normalised to 1; counts are written in where they are legible."""
    size = min(4.5 + 0.28 * len(classes), 22)
    figure = Figure(figsize=(size, size), layout="constrained")
    axes = figure.subplots()
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    image = axes.imshow(shares, vmin=0, vmax=1, cmap="viridis")
    places = np.arange(len(classes))
    axes.set_xticks(places, classes, rotation=90, fontsize=7)
    axes.set_yticks(places, classes, fontsize=7)
    if len(classes) <= 30:
        for row, column in zip(*np.nonzero(counts), strict=True):
            colour = "black" if shares[row, column] > 0.6 else "white"
            axes.text(
                column, row, counts[row, column], ha="center", va="center", fontsize=7, color=colour
            )
    axes.set(xlabel="predicted", ylabel="true", title=title)
    figure.colorbar(image, ax=axes, shrink=0.7, label="share of the true class")
    return figure


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
    figure, grid = _grid(len(titles))
    for axes, spectrogram, title in zip(grid, spectrograms, titles, strict=False):
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
    figure, grid = _grid(len(titles))
    pixels = patches.permute(0, 2, 3, 1).numpy() * np.array(STD) + np.array(MEAN)
    for axes, patch, title in zip(grid, pixels.clip(0, 1), titles, strict=False):
        axes.imshow(patch)
        axes.set_title(title, fontsize=7)
        axes.set_axis_off()
    return figure


def save_figure(figure: Figure, path: Path) -> None:
    """Save as PNG, making the folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


def _grid(count: int) -> tuple[Figure, list[Axes]]:
    columns = min(count, 4)
    rows = -(-count // columns)
    figure = Figure(figsize=(3 * columns, 2.4 * rows), layout="constrained")
    return figure, list(np.atleast_1d(figure.subplots(rows, columns)).ravel())
