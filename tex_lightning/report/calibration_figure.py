"""Figure of the reliability of test samples' probabilities."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from tex_lightning.evaluation.calibration import BINS, confidences, correct_votes, risk_coverage
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.report.style import GUIDE, colour_of, styled


@styled
def calibration_figure(outcomes: Sequence[Outcome], name: str) -> Figure:
    """Reliability in 15 bins, and error against coverage, of the network of this name."""
    confidence, correct = confidences(outcomes), correct_votes(outcomes)
    figure = Figure(figsize=(7, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    edges = np.linspace(0, 1, BINS + 1)
    place = np.clip(np.digitize(confidence, edges[1:-1], right=True), 0, BINS - 1)
    used, counts = np.unique(place, return_counts=True)
    centres = (edges[used] + edges[used + 1]) / 2
    shares = [correct[place == n].mean() for n in used]
    left.plot([0, 1], [0, 1], color=GUIDE, linestyle="--")
    left.bar(centres, shares, width=1 / BINS, color=colour_of(name), edgecolor="white")
    slanted = 90 if counts.max() > 999 else 0
    for centre, count in zip(centres, counts, strict=True):
        left.annotate(
            str(count), (centre, 1), (0, 2), ha="center", fontsize=6, rotation=slanted,
            xycoords=("data", "axes fraction"), textcoords="offset points",
        )  # fmt: skip
    left.set_title("samples of each bin above it", fontsize=7, pad=24 if slanted else 12)
    left.set(xlim=(0, 1), ylim=(0, 1), xlabel="probability of the label", ylabel="correct votes")
    coverage, wrong = risk_coverage(confidence, correct)
    right.plot(coverage, wrong, drawstyle="steps-post", color=colour_of(name))
    right.set(xlim=(0, 1), ylim=(0, None), xlabel="samples with a label", ylabel="wrong, of all")
    for axis in (left.xaxis, left.yaxis, right.xaxis, right.yaxis):
        axis.set_major_formatter(PercentFormatter(1))
    figure.suptitle(f"{name}: {len(outcomes)} test samples")
    return figure
