"""Charts of ``task=profile``."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from tex_lightning.profiling.growth import Point
from tex_lightning.report.figures import make_grid
from tex_lightning.report.paper import paper_table
from tex_lightning.report.profile_table import WAYS, Network
from tex_lightning.report.style import GUIDE, Look, colour_of, looks, styled

PARTS = {"label": "-", "network": "-", "features": ":"}


@styled
def ways_figure(name: str, network: Network) -> Figure:
    """Bars of all ways to classify one recording, on a logarithmic axis, the paper's below."""
    paper = paper_table("profiling")
    bars = [
        (title, network[f"{key}_ms"], colour_of(name))
        for key, title in WAYS.items()
        if f"{key}_ms" in network
    ]
    if name in paper:
        for key, title in (("sliding_window", WAYS["sliding_window"]), ("fcn", "FCN")):
            bars.append((f"paper: {title}, {paper['device']}", paper[name][f"{key}_ms"], GUIDE))
    figure = Figure(figsize=(8, 0.4 * len(bars) + 1.2), layout="constrained")
    axes = figure.subplots()
    titles, values, colours = zip(*bars, strict=True)
    drawn = axes.barh(np.arange(len(bars)), values, color=colours)
    shown = [f"{value:,.0f}" if value >= 100 else f"{value:.3g}" for value in values]
    axes.bar_label(drawn, shown, padding=3)
    axes.set_yticks(np.arange(len(bars)), titles)
    axes.margins(x=0.2)
    axes.invert_yaxis()
    axes.set(
        xscale="log",
        xlabel="median ms",
        title=f"{name}: {network['windows']} windows or one dense pass",
    )
    return figure


@styled
def layers_figure(name: str, network: Network) -> Figure:
    """Time of every layer, and the time its arithmetic takes at the rate of matrix products."""
    layers, rate = network["layers"], network["gemm_gflops"]
    figure = Figure(figsize=(8, 0.25 * len(layers) + 1.4), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(layers))
    ideal = [2 * layer["macs"] / rate / 1e6 for layer in layers]
    axes.barh(places, [layer["ms"] for layer in layers], color=colour_of(name), label="measured")
    axes.barh(places, ideal, height=0.35, color="black", label="at the rate of matrix products")
    names = [f"{layer['name']} ({layer['kind']})" for layer in layers]
    axes.set_yticks(places, names)
    axes.invert_yaxis()
    axes.legend()
    axes.set(xlabel="ms", title=f"{name}: where the time goes")
    return figure


@styled
def growth_figure(points: Sequence[Point]) -> Figure:
    """Time against everything that can grow, both axes logarithmic; grey: in proportion."""
    done = [point for point in points if point.median_ms is not None]
    names = list(dict.fromkeys(point.axis for point in done))
    drawn = looks(dict.fromkeys(point.network for point in done))
    figure, grid = make_grid(len(names), 3, (4, 3.2))
    for axes, name in zip(grid, names, strict=True):
        _growth_panel(axes, name, [point for point in done if point.axis == name], drawn)
    return figure


def _growth_panel(
    axes: Axes, name: str, points: Sequence[Point], drawn: Mapping[str, Look]
) -> None:
    for network, part in dict.fromkeys((point.network, point.part) for point in points):
        line = [point for point in points if (point.network, point.part) == (network, part)]
        values = np.array([point.value for point in line])
        axes.loglog(
            values,
            [point.median_ms for point in line],
            PARTS[part],
            marker=drawn[network].marker,
            markersize=3,
            color=drawn[network].colour,
            label=f"{network} {part}",
        )
    times = [point.median_ms or 0 for point in points]
    top = max(points, key=lambda point: point.median_ms or 0)
    values = np.array(sorted({point.value for point in points}))
    slope = -1 if name == "threads" else 1
    guide = max(times) * (values / top.value) ** slope
    axes.loglog(values, guide, color="#dddddd", zorder=0)
    axes.set_ylim(min(times) / 2, max(times) * 2)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,g}"))
        axis.set_minor_formatter(NullFormatter())
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    if name == "threads":
        axes.set_xticks(values)
    axes.set(xlabel=name, ylabel="median ms")
    axes.legend()
