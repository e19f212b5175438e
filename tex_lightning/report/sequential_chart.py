"""Cost and agreement of sequential decisions over their thresholds."""

from collections.abc import Sequence

from adjustText import adjust_text
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from tex_lightning.evaluation.early_stopping import Setting
from tex_lightning.report.style import GUIDE, colour_of, styled

STYLES = {"alpha": "o-", "confidence_threshold": "s--"}  # of the knobs' lines
USED = "used"
SHOWN = {"agreed": "same label as the full decision", "correct": "correct votes"}


@styled
def sequential_figure(settings: Sequence[Setting], name: str) -> Figure:
    """Agreement and accuracy against the share of the arithmetic, a line for each knob.

    Args:
        settings: Thresholds with their counts.
        name: Name of the network, in whose colour the lines are.
    """
    figure = Figure(figsize=(7, 3.4), layout="constrained")
    panels = dict(zip(SHOWN, figure.subplots(1, 2, sharex=True), strict=True))
    for key, axes in panels.items():
        _draw(axes, settings, key, colour_of(name))
    legend = next(iter(panels.values())).get_legend_handles_labels()
    figure.legend(*legend, loc="outside lower center", ncols=3)
    figure.suptitle(f"{name}: {settings[0].test_samples} test samples, thresholds at the points")
    figure.draw_without_rendering()  # only then it is known where the points are
    for key, axes in panels.items():
        _name_thresholds(axes, settings, key)
    return figure


def _draw(axes: Axes, settings: Sequence[Setting], key: str, colour: str) -> None:
    for knob, style in STYLES.items():
        own = [item for item in settings if item.knob == knob]
        if line := sorted(own, key=lambda item: item.relative_macs):
            axes.plot(*_points(line, key), style, color=colour, label=knob)
    used = [item for item in settings if item.knob == USED]
    axes.plot(*_points(used, key), "*", color="black", markersize=8, label=USED, zorder=3)
    axes.xaxis.set_major_formatter(PercentFormatter(1))
    axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=1))
    axes.set(xlabel="arithmetic, of the full decision's", ylabel=SHOWN[key])
    axes.margins(0.1)


def _name_thresholds(axes: Axes, settings: Sequence[Setting], key: str) -> None:
    """Each threshold beside its point, moved to where it covers no other."""
    named = [item for item in settings if item.knob != USED]
    texts = [
        axes.text(x, y, f"{item.value:g}", fontsize=6)
        for x, y, item in zip(*_points(named, key), named, strict=True)
    ]
    line = {"arrowstyle": "-", "color": GUIDE, "linewidth": 0.5}
    adjust_text(texts, *_points(settings, key), ax=axes, iter_lim=100, arrowprops=line)


def _points(settings: Sequence[Setting], key: str) -> tuple[list[float], list[float]]:
    return (
        [item.relative_macs for item in settings],
        [getattr(item, key) / item.test_samples for item in settings],
    )
