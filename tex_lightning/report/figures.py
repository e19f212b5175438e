"""Figures, drawn without a display; the function that saves them closes them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from torch import Tensor, nn

from tex_lightning.core.files import write_atomically
from tex_lightning.evaluation.calibration import BINS, confidences, correct_votes, risk_coverage
from tex_lightning.evaluation.early_stopping import Setting
from tex_lightning.evaluation.outcomes import Outcome, wilson_interval
from tex_lightning.networks.blocks import MEAN, STD
from tex_lightning.report.style import GUIDE, brief, colour_of, looks, styled
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures
from tex_lightning.text import printable, to_markdown

KNOBS = {"alpha": "o-", "confidence_threshold": "s--", "used": "*"}  # styles of their lines
PANELS = {"agreed": "same label as the full decision", "correct": "correct votes"}


def draw_shares(
    axes: Axes,
    shares: npt.NDArray[np.float64],
    rows: Sequence[str],
    columns: Sequence[str],
    texts: Mapping[tuple[int, int], str],
    label: str,
    gamma: float = 1,
) -> None:
    """Colours for a table of shares from 0 to 1 (rows, columns), and texts in some of its cells.

    A colour bar with the ``label`` explains them. A ``gamma`` below 1 brings out small shares.
    """
    rows, columns = (list(map(printable, names)) for names in (rows, columns))
    image = axes.imshow(shares, norm=PowerNorm(gamma, 0, 1), cmap="viridis", aspect="auto")
    axes.set_xticks(range(len(columns)), columns, rotation=90)
    axes.set_yticks(range(len(rows)), rows)
    for (row, column), text in texts.items():
        colour = "black" if shares[row, column] ** gamma > 0.6 else "white"
        axes.text(column, row, text, ha="center", va="center", fontsize=7, color=colour)
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


def save_figure(figure: Figure, path: Path) -> Path:
    """Save as PNG, whole or not at all, and return the file.

    Args:
        figure: Is laid out once; loggers, which draw it again, find it so.
        path: Without a suffix.

    Raises:
        UserError: If it cannot be written.
    """
    file = path.with_name(f"{path.name}.png")
    write_figure(figure, file)
    figure.set_layout_engine("none")
    return file


def picture(words: str, file: Path) -> str:
    """Markdown that shows a figure in ``figures/``."""
    return f"![{to_markdown(words)}]({file.parent.name}/{quote(file.name)})"


@styled
def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG; see :func:`save_figure`."""
    write_atomically(path, lambda partial: figure.savefig(partial, format="png"))


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


@styled
def calibration_figure(outcomes: Sequence[Outcome], name: str) -> Figure:
    """Draw reliability in 15 bins, and error against coverage, of the network of this name."""
    confidence, correct = confidences(outcomes), correct_votes(outcomes)
    figure = Figure(figsize=(7, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    edges = np.linspace(0, 1, BINS + 1)
    bins = np.clip(np.digitize(confidence, edges[1:-1], right=True), 0, BINS - 1)
    used, counts = np.unique(bins, return_counts=True)
    shares = [correct[bins == n].mean() for n in used]
    centres = (edges[used] + edges[used + 1]) / 2
    left.plot([0, 1], [0, 1], color=GUIDE, linestyle="--")
    left.bar(centres, shares, width=1 / BINS, color=colour_of(name), edgecolor="white")
    above = left.secondary_xaxis("top")
    above.set_xticks(centres, map(str, counts), fontsize=6, rotation=90)
    above.set_xlabel("samples of each bin", fontsize=7)
    left.set(xlim=(0, 1), ylim=(0, 1), xlabel="probability of the label", ylabel="correct votes")
    coverage, wrong = risk_coverage(confidence, correct)
    right.plot(coverage, wrong, drawstyle="steps-post", color=colour_of(name))
    right.set(xlim=(0, 1), ylim=(0, None), xlabel="samples with a label", ylabel="wrong, of all")
    for axis in (left.xaxis, left.yaxis, right.xaxis, right.yaxis):
        axis.set_major_formatter(PercentFormatter(1))
    figure.suptitle(f"{name}: {len(outcomes)} test samples")
    return figure


@styled
def sequential_figure(settings: Sequence[Setting], name: str) -> Figure:
    """Draw agreement and accuracy against the share of the arithmetic, a line for each knob.

    Args:
        settings: Thresholds with their counts, and what is used.
        name: Name of the network, in whose colour the lines are.
    """
    figure = Figure(figsize=(7, 3.4), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True)
    for axes, (key, words) in zip(panels, PANELS.items(), strict=True):
        for knob, style in KNOBS.items():
            points = sorted(
                (item.relative_macs, getattr(item, key) / item.test_samples, item.value)
                for item in settings
                if item.knob == knob
            )
            if not points:
                continue
            across, upwards, _ = zip(*points, strict=True)
            colour = "black" if knob == "used" else colour_of(name)
            axes.plot(across, upwards, style, color=colour, label=knob)
            for x, y, value in points if knob != "used" else ():
                axes.annotate(f"{value:g}", (x, y), (2, 3), textcoords="offset points", fontsize=6)
        axes.xaxis.set_major_formatter(PercentFormatter(1))
        axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=1))
        axes.set(xlabel="arithmetic, of the full decision's", ylabel=words)
        axes.margins(0.1)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.suptitle(f"{name}: {settings[0].test_samples} test samples, thresholds at the points")
    return figure


class LearningPoint(NamedTuple):
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


@styled
def learning_figure(curves: Mapping[str, Sequence[LearningPoint]]) -> Figure:
    """Draw a line with intervals for every system, over a logarithmic axis of recordings."""
    figure = Figure(figsize=(7, 4.2), layout="constrained")
    axes = figure.subplots()
    for name, look in looks(curves).items():
        points = curves[name]
        shares = [point.accuracy for point in points]
        bounds = np.abs(np.transpose([point.interval for point in points]) - shares)
        axes.errorbar(
            [point.per_class for point in points], shares, bounds, marker=look.marker,
            color=look.colour, capsize=3, label=brief(name),
        )  # fmt: skip
    ticks = sorted({point.per_class for points in curves.values() for point in points})
    axes.set_xscale("log")
    axes.set_xticks(ticks, map(str, ticks))
    axes.set_xticks([], minor=True)
    axes.yaxis.set_major_formatter(PercentFormatter(1))
    axes.set(
        xlabel="recordings of each class trained on",
        ylabel="correct votes with Wilson's 95 % interval",
    )
    axes.grid(axis="y")
    figure.legend(loc="outside right center")
    return figure
