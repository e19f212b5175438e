"""Why a sample got its label: the dense scores of every sense, and a picture of them."""

import textwrap
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch

from tex_lightning.inference.evidence import Evidence, PhotoEvidence, SignalEvidence
from tex_lightning.inference.prediction import Prediction
from tex_lightning.report.evidence_panels import OTHERS, SMALL, Key, draw_photo, draw_signal
from tex_lightning.report.figures import write_figure
from tex_lightning.report.labels import brief
from tex_lightning.report.style import styled
from tex_lightning.text import printable, printable_lines

# Tol's bright palette for colour-blind readers, the winner's first, and two of his vibrant one
COLOURS = ("#4477aa", "#ee6677", "#ccbb44", "#228833", "#66ccee", "#aa3377", "#ee7733", "#332288")
WIDTH = 12.0  # inches
HEIGHTS = {"signal": 3.7, "photo": 3.1, "fused": 1.3, "line": 0.22}
LINE = 150  # characters
DPI = 100


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
        heights = [HEIGHTS[_medium(each)] for each in self.senses.values()]
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
        """Write the figure as PNG, PDF or SVG, by the suffix.

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
        """An entry for each class that occurs, and one for all without a colour of their own."""
        found = [
            Patch(color=colour, label=brief(self.classes[label], LINE))
            for label, colour in key.colours.items()
        ]
        occurring = {
            int(label) for each in self.senses.values() for label in np.unique(each.labels)
        }
        if rest := len(occurring - key.colours.keys()):
            found.append(Patch(color=OTHERS, label=f"{rest} other classes"))
        return found

    def _draw(self, part: SubFigure, evidence: Evidence, key: Key) -> None:
        rival, margin = key.name(self.rival), self.contributions[evidence.name]
        title = f"{evidence.name}: mean margin {margin:+.1f} over {rival}"
        if not evidence.declared:
            title += f"; positions drawn as equal parts of the {evidence.what}"
        if isinstance(evidence, SignalEvidence) and not evidence.is_read:
            title += "; the spectrogram is not what the network reads"
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


def _medium(evidence: Evidence) -> str:
    return "signal" if isinstance(evidence, SignalEvidence) else "photo"


def _bars(axes: Axes, names: list[str], values: list[float], colours: str | list[str]) -> None:
    axes.barh(range(len(names)), values, color=colours)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.tick_params(labelsize=SMALL)
