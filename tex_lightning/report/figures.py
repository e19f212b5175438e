"""Figures, drawn without a display; the function that saves them closes them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from torch import Tensor, nn

from tex_lightning.core.files import write_atomically
from tex_lightning.features.image import MEAN, STD
from tex_lightning.features.spectrogram import SpectrogramFeatures
from tex_lightning.report.style import styled
from tex_lightning.text import printable, to_markdown

SHOWN = (".png", ".svg", ".pdf")  # by a browser, the first of them rather
UNDATED = {"pdf": "CreationDate", "svg": "Date"}  # so that the same figure gives the same file


def draw_shares(
    axes: Axes,
    shares: npt.NDArray[np.float64],
    rows: Sequence[str],
    columns: Sequence[str],
    texts: Mapping[tuple[int, int], str],
    label: str | None,
    gamma: float = 1,
) -> None:
    """Colours for a table of shares from 0 to 1 (rows, columns), and texts in some of its cells.

    A colour bar with the ``label`` explains them, unless that is None. A ``gamma`` below 1
    brings out small shares.
    """
    rows, columns = (list(map(printable, names)) for names in (rows, columns))
    image = axes.imshow(shares, norm=PowerNorm(gamma, 0, 1), cmap="viridis", aspect="auto")
    axes.set_xticks(range(len(columns)), columns, rotation=90)
    axes.set_yticks(range(len(rows)), rows)
    for (row, column), text in texts.items():
        colour = "black" if shares[row, column] ** gamma > 0.6 else "white"
        axes.text(column, row, text, ha="center", va="center", fontsize=7, color=colour)
    if label is None:
        return
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.6, label=label)
    bar.ax.yaxis.set_major_formatter(PercentFormatter(1))


@styled
def spectrogram_figure(spectrograms: Tensor, titles: list[str], features: nn.Module) -> Figure:
    """Network inputs (count, bands, frames) of signals side by side."""
    figure, grid = make_grid(len(titles), 4, (3, 2.4))
    for axes, spectrogram, title in zip(grid, spectrograms, titles, strict=True):
        across, upwards = draw_spectrogram(axes, spectrogram, features)
        axes.set_title(printable(title), fontsize=7)
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


@styled
def patch_figure(patches: Tensor, titles: list[str]) -> Figure:
    """Normalised patches (count, 3, height, width) side by side, in their own colours."""
    figure, grid = make_grid(len(titles), 4, (3, 2.4))
    pixels = patches.permute(0, 2, 3, 1).numpy() * np.array(STD) + np.array(MEAN)
    for axes, patch, title in zip(grid, pixels.clip(0, 1), titles, strict=True):
        axes.imshow(patch)
        axes.set_title(printable(title), fontsize=7)
        axes.set_axis_off()
    return figure


def save_figure(figure: Figure, path: Path, formats: Sequence[str]) -> Path:
    """Save in every one of the formats, making the folder.

    Args:
        figure: Is laid out by the first, and then not again.
        path: Without a suffix.
        formats: ``png``, ``pdf``, ``svg``; at least one.

    Returns:
        The file that a browser shows best.
    """
    files = [path.with_name(f"{path.name}.{name}") for name in formats]
    for file in files:
        write_figure(figure, file)
        figure.set_layout_engine("none")  # also for loggers, which draw it again
    return min(files, key=lambda file: SHOWN.index(file.suffix))


def picture(words: str, file: Path) -> str:
    """Markdown for a figure in ``figures/``: shown, or of a PDF, which no browser shows, a link."""
    link = f"[{to_markdown(words)}]({file.parent.name}/{quote(file.name)})"
    return link if file.suffix == ".pdf" else f"!{link}"


@styled
def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as its suffix says, whole or not at all.

    Raises:
        UserError: If it cannot be written.
    """
    kind = path.suffix.lower().removeprefix(".")
    undated = {UNDATED[kind]: None} if kind in UNDATED else {}

    def write(partial: Path) -> None:
        figure.savefig(partial, format=kind, metadata=undated)

    write_atomically(path, write)


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
