"""Cost and agreement of sequential decisions over their thresholds."""

from collections.abc import Sequence

import matplotlib.ticker
from matplotlib.figure import Figure

from tex_lightning.evaluation.early_stopping import Setting

COLOURS = {"alpha": "#4477aa", "confidence_threshold": "#cc6677", "used": "#222222"}


def sequential_figure(settings: Sequence[Setting], title: str) -> Figure:
    """Agreement and accuracy against the share of the arithmetic, a line for each knob."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2, sharex=True), ("agreed", "correct"), strict=True):
        for knob, colour in COLOURS.items():
            own = [item for item in settings if item.knob == knob]
            line = sorted(own, key=lambda item: item.relative_macs)
            shares = [getattr(item, name) / item.test_samples for item in line]
            marks = "*" if knob == "used" else "o-"
            if line:
                macs = [item.relative_macs for item in line]
                axes.plot(macs, shares, marks, color=colour, label=knob)
            for item, share in zip(line, shares, strict=True):
                if knob != "used":
                    axes.annotate(f"{item.value:g}", (item.relative_macs, share), fontsize=6)
        axes.yaxis.set_major_formatter(matplotlib.ticker.PercentFormatter(1, decimals=1))
        axes.set(xlabel="arithmetic, share of the full decision's")
        axes.set_ylabel("same label as the full decision" if name == "agreed" else "correct votes")
        axes.legend()
    figure.suptitle(title)
    return figure
