"""Cost and agreement of sequential decisions over their thresholds."""

from collections.abc import Sequence

import matplotlib.ticker
from matplotlib.figure import Figure

from tex_lightning.evaluation.early_stopping import Setting


def sequential_figure(settings: Sequence[Setting], title: str) -> Figure:
    """Agreement and accuracy against the share of the arithmetic, a line for each knob."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2, sharex=True), ("agreed", "correct"), strict=True):
        for knob, colour in (("alpha", "#4477aa"), ("enough", "#cc6677"), ("used", "#222222")):
            line = sorted(
                (item for item in settings if item.knob == knob), key=lambda item: item.evidence
            )
            shares = [getattr(item, name) / item.test_samples for item in line]
            marks = "*" if knob == "used" else "o-"
            if line:
                axes.plot([item.evidence for item in line], shares, marks, color=colour, label=knob)
            for item, share in zip(line, shares, strict=True):
                if knob != "used":
                    axes.annotate(f"{item.value:g}", (item.evidence, share), fontsize=6)
        axes.yaxis.set_major_formatter(matplotlib.ticker.PercentFormatter(1, decimals=1))
        axes.set(xlabel="arithmetic, share of the full decision's")
        axes.set_ylabel("same label as the full decision" if name == "agreed" else "right votes")
        axes.legend()
    figure.suptitle(title)
    return figure
