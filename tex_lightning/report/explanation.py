"""Explanations: the dense scores of every sense behind a label, drawn over its recordings."""

import textwrap
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from PIL import Image

from tex_lightning.inference.evidence import Evidence, Floats, PhotoEvidence, SignalEvidence
from tex_lightning.inference.prediction import Prediction
from tex_lightning.report.figures import write_figure
from tex_lightning.report.style import brief, styled
from tex_lightning.text import printable, printable_lines

# Tol's bright palette for colour-blind readers, the winner's first, and two of his vibrant one
COLOURS = ("#4477aa", "#ee6677", "#ccbb44", "#228833", "#66ccee", "#aa3377", "#ee7733", "#332288")
WIDTH = 12.0  # inches
HEIGHTS = {"signal": 3.7, "photo": 3.1, "fused": 1.3, "line": 0.22}
LINE = 150  # characters
DPI = 100
OTHERS = "#bbbbbb"  # of classes without a colour of their own
SHOWN = 300  # pixels of a photo's longer side that are drawn
BINS = 1200  # of a waveform, each drawn from its lowest to its highest sample
MIX = 0.5  # of a class's colour over a grey photo
SMALL = 7  # font size
AXES = ("#222222", "#4477aa", "#ccbb44")  # of a signal
LONGEST = 28  # characters of a class name in a panel


@dataclass(frozen=True)
class Key:
    """Names and colours of the classes.

    Attributes:
        classes: All names.
        label: Index of the class that won.
        colours: By index, of those that have one.
    """

    classes: list[str]
    label: int
    colours: Mapping[int, str]

    def name(self, label: int) -> str:
        """Name of a class; the middle of a long one is left out."""
        return brief(self.classes[label], LONGEST)

    def colour(self, label: int) -> str:
        """Colour of a class, or that of all classes without their own."""
        return self.colours.get(label, OTHERS)

    def claim(self, evidence: Evidence, place: tuple[int, int], most: bool) -> str:
        """Lead or lag of the winning class at a position, in two lines."""
        margin = float(evidence.margins(self.label)[place])
        rival = self.name(int(evidence.rivals(self.label)[place]))
        said = "most for" if most else "least for" if margin >= 0 else "most against"
        versus = f"+{margin:.1f} over" if margin >= 0 else f"{-margin:.1f} behind"
        return f"{said} {self.name(self.label)}\n{versus} {rival}"


def draw_photo(figure: SubFigure, evidence: PhotoEvidence, key: Key) -> None:
    """The photo, the class of every position over it, and two fragments enlarged."""
    height, width = evidence.pixels.shape[:2]
    wide = min(max(1.0, width / height), 1.6)
    photo, mapped, *enlarged = figure.subplots(1, 4, width_ratios=(wide, wide, 1, 1))
    step = -(-max(height, width) // SHOWN)
    small = np.asarray(Image.fromarray(evidence.pixels).reduce(step))
    extent = (0, small.shape[1] * step, small.shape[0] * step, 0)
    _show_pixels(photo, small, extent)
    _show_pixels(mapped, overlaid(evidence, step, key), extent)
    photo.set_title("photo, in pixels", fontsize=SMALL + 1)
    mapped.set_title("class of every position", fontsize=SMALL + 1)
    for axes in (photo, mapped):
        axes.set(xlim=(0, width), ylim=(height, 0))
    for axes, place, style in _marked(evidence, key, enlarged):
        row, column = place
        begins, ends = np.stack((evidence.rows[row], evidence.columns[column]), axis=1)
        top, left = begins.astype(int)
        bottom, right = np.minimum(np.ceil(ends), (height, width)).astype(int)
        _mark(mapped, (left, top), (right - left, bottom - top), style)
        cut = Image.fromarray(evidence.pixels[top:bottom, left:right])
        fine = -(-max(cut.size) // SHOWN)
        _show_pixels(axes, np.asarray(cut.reduce(fine)), (left, right, bottom, top))


def _show_pixels(
    axes: Axes, pixels: npt.NDArray[Any], extent: tuple[float, float, float, float]
) -> None:
    axes.imshow(pixels, extent=extent)
    axes.tick_params(labelsize=SMALL)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4))


def overlaid(evidence: PhotoEvidence, step: int, key: Key) -> Floats:
    """A grey photo under the colours of its classes (height, width, 3), 0 to 1."""
    grey = np.asarray(Image.fromarray(evidence.pixels).convert("L").reduce(step)) / 255
    labels = evidence.label_map(step)
    pixels = np.repeat(grey[..., None], 3, axis=2)
    for label in np.unique(labels[labels >= 0]).tolist():
        own = labels == label
        pixels[own] = (1 - MIX) * pixels[own] + MIX * np.array(to_rgb(key.colour(label)))
    return pixels


def draw_signal(figure: SubFigure, evidence: SignalEvidence, key: Key) -> None:
    """Waveform, spectrogram, class and probability over time, and two fragments enlarged."""
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(2.6, 1))[0]
    grid = left.subplots(4, 1, sharex=True, height_ratios=(1, 1.7, 0.25, 0.7))
    wave, spectrogram, strip, line = grid
    _draw_wave(wave, evidence)
    _draw_spectrogram(spectrogram, evidence, (0, len(evidence.times)))
    _draw_strip(strip, evidence, key)
    _draw_probability(line, evidence, key)
    for axes in grid:
        axes.tick_params(labelsize=SMALL)
    for axes, place, style in _marked(evidence, key, list(right.subplots(2, 1))):
        begin, end = evidence.columns[place[1]].clip(0, evidence.seconds)
        bands = len(evidence.frequencies)
        _mark(spectrogram, (begin, -0.5), (end - begin, bands), style)
        frames = np.searchsorted(evidence.times, (begin, end))
        _draw_spectrogram(axes, evidence, (int(frames[0]), int(frames[1])))
        axes.xaxis.set_major_locator(MaxNLocator(4))
        axes.set_xlabel("s", fontsize=SMALL)


def _draw_wave(axes: Axes, evidence: SignalEvidence) -> None:
    count = evidence.samples.shape[1]
    bins = min(BINS, count)
    begins = np.arange(bins) * count // bins
    for samples, colour in zip(evidence.samples, AXES, strict=False):
        low, high = (each.reduceat(samples, begins) for each in (np.minimum, np.maximum))
        axes.fill_between(begins / evidence.rate, low, high, color=colour, alpha=0.7, linewidth=0.3)
    axes.axvline(evidence.start, color="#cc3311", linestyle="--", linewidth=1)
    text = f"movement from {evidence.start:.2f} s"
    axes.set_title(text, loc="left", fontsize=SMALL, color="#cc3311", pad=2)
    axes.set_xlim(0, evidence.seconds)
    axes.set_ylabel("signal", fontsize=SMALL)


def _draw_spectrogram(axes: Axes, evidence: SignalEvidence, frames: tuple[int, int]) -> None:
    first, last = frames
    axes.set_ylabel("Hz", fontsize=SMALL)
    axes.tick_params(labelsize=SMALL)
    if evidence.input is None or last - first < 1:
        return
    bands = len(evidence.frequencies)
    hop = float(np.diff(evidence.times[:2]).sum()) or evidence.seconds
    begin, end = evidence.times[[first, last - 1]] + (-hop / 2, hop / 2)
    axes.imshow(
        evidence.input[:, first:last],
        origin="lower",
        aspect="auto",
        cmap="magma",
        extent=(begin, end, -0.5, bands - 0.5),
        vmin=float(evidence.input.min()),
        vmax=float(evidence.input.max()),
    )
    named = [f"{hertz:.0f}" for hertz in evidence.frequencies[::10]]
    axes.set_yticks(range(0, bands, 10), named)


def _draw_strip(axes: Axes, evidence: SignalEvidence, key: Key) -> None:
    labels, edges = evidence.labels[0], evidence.edges
    turns = np.flatnonzero(np.diff(labels)) + 1
    begins, ends = np.concatenate(([0], turns)), np.concatenate((turns, [len(labels)]))
    colours = [key.colour(int(label)) for label in labels[begins]]
    axes.bar(edges[begins], 1, edges[ends] - edges[begins], align="edge", color=colours)
    axes.set(yticks=[], ylim=(0, 1))
    axes.set_ylabel("class", fontsize=SMALL, rotation=0, ha="right", va="center")


def _draw_probability(axes: Axes, evidence: SignalEvidence, key: Key) -> None:
    centres: Floats = evidence.columns.mean(axis=1).clip(0, evidence.seconds)
    values = evidence.probabilities(key.label)[0]
    mark = "." if len(centres) <= 60 else ""
    axes.plot(centres, values, color=key.colour(key.label), marker=mark, linewidth=1)
    axes.set(ylim=(-0.05, 1.05), yticks=(0, 0.5, 1))
    axes.set_ylabel("probability", fontsize=SMALL)
    axes.set_xlabel("s", fontsize=SMALL)


def _marked(
    evidence: Evidence, key: Key, panels: list[Axes]
) -> list[tuple[Axes, tuple[int, int], str]]:
    """Panel, position and line style of the fragment for and of that against the winner."""
    most, least = evidence.extremes(key.label)
    found = []
    for axes, place, style in zip(panels, (most, least), ("-", "--"), strict=True):
        if style == "--" and least == most:  # there is but one position
            axes.set_axis_off()
            continue
        axes.set_title(key.claim(evidence, place, style == "-"), fontsize=SMALL + 1)
        axes.tick_params(labelsize=SMALL)
        for spine in axes.spines.values():
            spine.set_linestyle("-" if style == "-" else "--")
        found.append((axes, place, style))
    return found


def _mark(axes: Axes, corner: tuple[float, float], size: tuple[float, float], style: str) -> None:
    frame = Rectangle(corner, *size, fill=False, edgecolor="white", linewidth=1.3, linestyle=style)
    frame.set_path_effects([withStroke(linewidth=3, foreground="black")])
    axes.add_patch(frame)


@dataclass(frozen=True)
class Explanation:
    """The dense scores of every sense behind a label.

    Attributes:
        prediction: The prediction of ``predict``, from the same pass.
        classes: Names in the order of the scores.
        label: Index of the class that won the vote, also where it was rejected.
        rival: Index of the runner-up, the other class with the largest mean score.
        senses: Dense scores by the name of each sense that was used.

    Example:
        >>> import tex_lightning as tl
        >>> found = tl.load("RUN").explain(haptic="A.wav", image="B.jpg")
        >>> found.senses["haptic"].scores.shape  # classes, one row, positions
        (3, 1, 4)
        >>> found.senses["visual"].label_map().shape  # of the photo
        (240, 240)
        >>> found.save("WHY.png")
    """

    prediction: Prediction
    classes: list[str]
    label: int
    rival: int
    senses: Mapping[str, Evidence]

    @classmethod
    def of(
        cls, prediction: Prediction, classes: list[str], label: int, senses: Mapping[str, Evidence]
    ) -> "Explanation":
        """Find the rival of the class that won."""
        means = sum(each.scores.mean(axis=(1, 2), dtype=np.float64) for each in senses.values())
        ranked = np.argsort(-np.asarray(means), kind="stable").tolist()
        rival = next(index for index in ranked if index != label)
        return cls(prediction, classes, label, rival, senses)

    @property
    def contributions(self) -> dict[str, float]:
        """Return, by sense, the mean over its positions of the winner's score less the rival's.

        Their sum is the lead of the winner in the mean score of a FusionNet's vote.
        """
        return {
            name: float((each.scores[self.label] - each.scores[self.rival]).mean(dtype=np.float64))
            for name, each in self.senses.items()
        }

    @property
    def title(self) -> str:
        """Return label, confidence, probability and warnings, in lines."""
        said, name = self.prediction, self.classes[self.label]
        lines = [
            f"{f'rejected, most like {name}' if said.rejected else name}: "
            f"confidence {said.confidence:.2f}, probability {said.probability:.2f}",
            *said.warnings,
        ]
        return "\n".join(line for text in lines for line in textwrap.wrap(text, LINE))

    @styled
    def figure(self, heading: str = "") -> Figure:
        """Draw the recordings with the class of every position; see ``docs/why.md``.

        Args:
            heading: A line above the title, such as the names of the files.
        """
        title = printable_lines("\n".join(filter(None, (printable(heading), self.title))))
        key = Key(self.classes, self.label, self._colours())
        legend = self._legend(key)
        columns = max(1, LINE // (8 + max(len(str(each.get_label())) for each in legend)))
        heights = [
            HEIGHTS["signal" if isinstance(sense, SignalEvidence) else "photo"]
            for sense in self.senses.values()
        ]
        fused = [HEIGHTS["fused"]] if len(self.senses) > 1 else []
        ratios = [*heights, *fused, HEIGHTS["line"] * (1 + -(-len(legend) // columns))]
        total = sum(ratios) + HEIGHTS["line"] * (title.count("\n") + 1)
        figure = Figure(figsize=(WIDTH, total), dpi=DPI, layout="constrained")
        figure.suptitle(title, fontsize=11)
        parts = figure.subfigures(len(ratios), 1, squeeze=False, height_ratios=ratios)[:, 0]
        for part, evidence in zip(parts, self.senses.values(), strict=False):
            self._draw(part, evidence, key)
        if fused:
            self._draw_fused(parts[-2], key)
        parts[-1].legend(handles=legend, loc="center", ncols=columns, fontsize=SMALL + 1)
        return figure

    def save(self, path: str | Path, heading: str = "") -> None:
        """Write the figure as PNG.

        Raises:
            UserError: If it cannot be written.
        """
        write_figure(self.figure(heading), Path(path).expanduser())

    def _colours(self) -> dict[int, str]:
        """The winner's, then those of the classes of most positions, in all senses alike."""
        shares: Counter[int] = Counter()
        for each in self.senses.values():
            labels, counts = np.unique(each.labels, return_counts=True)
            for label, count in zip(labels.tolist(), counts.tolist(), strict=True):
                shares[label] += count / each.labels.size
        others = sorted(shares.keys() - {self.label}, key=lambda label: (-shares[label], label))
        return dict(zip([self.label, *others], COLOURS, strict=False))

    def _legend(self, key: Key) -> list[Patch]:
        """Return an entry for each coloured class, and one for all others that occur."""
        entries = [
            Patch(color=colour, label=brief(self.classes[label], LINE))
            for label, colour in key.colours.items()
        ]
        occurring = {label for sense in self.senses.values() for label in sense.labels.flat}
        if rest := len(occurring - key.colours.keys()):
            entries.append(Patch(color=OTHERS, label=f"{rest} other classes"))
        return entries

    def _draw(self, part: SubFigure, evidence: Evidence, key: Key) -> None:
        rival, margin = key.name(self.rival), self.contributions[evidence.name]
        title = f"{evidence.name}: mean margin {margin:+.1f} over {rival}"
        part.suptitle(title, fontsize=SMALL + 2, ha="left", x=0.01)
        if isinstance(evidence, SignalEvidence):
            draw_signal(part, evidence, key)
        elif isinstance(evidence, PhotoEvidence):
            draw_photo(part, evidence, key)

    def _draw_fused(self, part: SubFigure, key: Key) -> None:
        """Draw how much each sense added, and the votes of all together."""
        added, votes = part.subplots(1, 2)
        found = self.contributions
        _bars(added, [*found, "sum"], [*found.values(), sum(found.values())], "#666666")
        added.axvline(0, color="black", linewidth=0.8)
        names = f"{key.name(self.label)} less that of {key.name(self.rival)}"
        added.set_xlabel(f"mean score of {names}", fontsize=SMALL)
        best = self.prediction.top_k
        labels = [self.classes.index(each["label"]) for each in best]
        colours = [key.colour(label) for label in labels]
        shares = [each["share"] for each in best]
        _bars(votes, [key.name(label) for label in labels], shares, colours)
        votes.set_xlim(0, 1)
        votes.set_xlabel("share of the votes of all senses together", fontsize=SMALL)


def _bars(axes: Axes, names: list[str], values: list[float], colours: str | list[str]) -> None:
    axes.barh(range(len(names)), values, color=colours)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.tick_params(labelsize=SMALL)
