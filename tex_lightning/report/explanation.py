"""Explanations: the dense scores of every sense behind a label, drawn over its recordings."""

import textwrap
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch
from PIL import Image

from tex_lightning.inference.evidence import Evidence, Floats
from tex_lightning.inference.prediction import Prediction
from tex_lightning.report.figures import write_figure
from tex_lightning.report.style import brief, styled
from tex_lightning.text import printable, printable_lines

# Tol's bright palette for colour-blind readers, the winner's first, and two of his vibrant one
COLOURS = ("#4477aa", "#ee6677", "#ccbb44", "#228833", "#66ccee", "#aa3377", "#ee7733", "#332288")
OTHERS = "#bbbbbb"  # of classes without a colour of their own
WIDTH, DPI = 12.0, 100  # inches, and pixels of one
SIGNAL, PHOTO, LINE = 3.0, 3.1, 0.22  # inches
CHARACTERS = 150  # of a line
LONGEST = 28  # characters of a class name in a panel
SHOWN = 300  # pixels of a photo's longer side that are drawn
FRAME = 512  # samples of a column of the spectrogram
MIX = 0.5  # of a class's colour over a grey photo


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
        return "\n".join(line for text in lines for line in textwrap.wrap(text, CHARACTERS))

    @styled
    def figure(self, heading: str = "") -> Figure:
        """Draw the recordings with the class of every position; see ``docs/predict.md``.

        Args:
            heading: A line above the title, such as the names of the files.
        """
        title = printable_lines("\n".join(filter(None, (printable(heading), self.title))))
        colours, legend = self._legend()
        columns = max(1, CHARACTERS // (8 + max(len(str(each.get_label())) for each in legend)))
        ratios = [PHOTO if e.rate is None else SIGNAL for e in self.senses.values()]
        ratios += [LINE * (1 + -(-len(legend) // columns))]
        total = sum(ratios) + LINE * (title.count("\n") + 1)
        figure = Figure(figsize=(WIDTH, total), dpi=DPI, layout="constrained")
        figure.suptitle(title, fontsize=11)
        parts = figure.subfigures(len(ratios), 1, squeeze=False, height_ratios=ratios)[:, 0]
        for part, evidence in zip(parts, self.senses.values(), strict=False):
            self._draw(part, evidence, colours)
        parts[-1].legend(handles=legend, loc="center", ncols=columns)
        return figure

    def save(self, path: str | Path, heading: str = "") -> None:
        """Write the figure as PNG.

        Raises:
            UserError: If it cannot be written.
        """
        write_figure(self.figure(heading), Path(path).expanduser())

    def _ranked(self) -> list[int]:
        """Return the winner, then all classes that occur, those of most positions first."""
        shares: dict[int, float] = defaultdict(float)
        for each in self.senses.values():
            for label, count in Counter(each.labels.ravel().tolist()).items():
                shares[label] += count / each.labels.size
        others = sorted(shares.keys() - {self.label}, key=lambda label: (-shares[label], label))
        return [self.label, *others]

    def _legend(self) -> tuple[list[str], list[Patch]]:
        """Return the colour of every class, and an entry for each coloured one and the others."""
        ranked, colours = self._ranked(), [OTHERS] * len(self.classes)
        entries = []
        for label, colour in zip(ranked, COLOURS, strict=False):
            colours[label] = colour
            entries.append(Patch(color=colour, label=brief(self.classes[label], CHARACTERS)))
        if rest := len(ranked) - len(entries):
            entries.append(Patch(color=OTHERS, label=f"{rest} other classes"))
        return colours, entries

    def _draw(self, part: SubFigure, evidence: Evidence, colours: Sequence[str]) -> None:
        """Draw one sense under its mean margin."""
        margin, rival = self.contributions[evidence.name], brief(self.classes[self.rival], LONGEST)
        part.suptitle(f"{evidence.name}: mean margin {margin:+.1f} over {rival}", ha="left", x=0.01)
        if evidence.rate is None:
            _draw_photo(part, evidence, colours)
        else:
            _draw_signal(part, evidence, colours, self.label)


def _draw_photo(figure: SubFigure, evidence: Evidence, colours: Sequence[str]) -> None:
    """Draw the photo, and the class of every position over it."""
    height, width = evidence.recording.shape[:2]
    photo, mapped = figure.subplots(1, 2)
    step = -(-max(height, width) // SHOWN)
    small = np.asarray(Image.fromarray(evidence.recording).reduce(step))
    extent = (0, small.shape[1] * step, small.shape[0] * step, 0)
    photo.imshow(small, extent=extent)
    grey = np.asarray(Image.fromarray(evidence.recording).convert("L").reduce(step)) / 255
    pixels, labels = np.repeat(grey[..., None], 3, axis=2), evidence.label_map(step)
    painted = np.array([to_rgb(colour) for colour in colours])[labels]
    pixels[labels >= 0] = (1 - MIX) * pixels[labels >= 0] + MIX * painted[labels >= 0]
    mapped.imshow(pixels, extent=extent)
    photo.set_title("photo, in pixels")
    mapped.set_title("class of every position")
    for axes in (photo, mapped):
        axes.set(xlim=(0, width), ylim=(height, 0))


def _draw_signal(figure: SubFigure, evidence: Evidence, colours: Sequence[str], label: int) -> None:
    """Draw spectrogram, class and probability over time."""
    spectrogram, strip, line = figure.subplots(3, 1, sharex=True, height_ratios=(2, 0.25, 0.7))
    _draw_spectrogram(spectrogram, evidence)
    labels, edges = evidence.labels[0], evidence.edges
    turns = np.flatnonzero(np.diff(labels, prepend=-1))
    ends = edges[[*turns[1:], len(labels)]]
    painted = [colours[index] for index in labels[turns]]
    strip.bar(edges[turns], 1, ends - edges[turns], align="edge", color=painted)
    strip.set(yticks=[], ylim=(0, 1), ylabel="class")
    centres: Floats = evidence.columns.mean(axis=1).clip(0, evidence.seconds)
    line.plot(centres, evidence.probabilities(label)[0], ".-", color=colours[label])
    line.set(ylim=(-0.05, 1.05), yticks=(0, 0.5, 1), xlabel="s", ylabel="probability")


def _draw_spectrogram(axes: Axes, evidence: Evidence) -> None:
    """Draw the spectrogram of the axis that varies most."""
    axes.axvline(evidence.start, color="#cc3311", linestyle="--")
    axes.set_title(f"movement from {evidence.start:.2f} s", loc="left", color="#cc3311", pad=2)
    strongest = evidence.recording[evidence.recording.std(axis=1).argmax()]
    length = min(FRAME, len(strongest))
    if length > 1:
        axes.specgram(
            strongest,
            NFFT=length,
            Fs=evidence.rate or 1.0,
            noverlap=length * 3 // 4,
            detrend="mean",
            cmap="magma",
        )
    axes.set(xlim=(0, evidence.seconds), ylabel="Hz")
