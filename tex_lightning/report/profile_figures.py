"""Charts of ``task=profile``."""

from collections.abc import Mapping, Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from tex_lightning.profiling.growth import Point
from tex_lightning.report.figures import make_grid
from tex_lightning.report.paper import paper_table
from tex_lightning.report.profile_table import WAYS, Network

COLOURS = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377")  # of networks
PARTS = {"label": "-", "network": "-", "features": ":"}


def ways_figure(name: str, network: Network) -> Figure:
    """Bars of all ways to classify one recording, on a logarithmic axis, the paper's below."""
    paper = paper_table("profiling")
    bars = [
        (title, network[f"{key}_ms"], "#4477aa")
        for key, title in WAYS.items()
        if f"{key}_ms" in network
    ]
    if name in paper:
        for key, title in (("sliding_window", WAYS["sliding_window"]), ("fcn", "FCN")):
            bars.append((f"paper: {title}, {paper['device']}", paper[name][f"{key}_ms"], "#bbbbbb"))
    figure = Figure(figsize=(8, 0.4 * len(bars) + 1.2), layout="constrained")
    axes = figure.subplots()
    titles, values, colours = zip(*bars, strict=True)
    drawn = axes.barh(np.arange(len(bars)), values, color=colours)
    shown = [f"{value:,.0f}" if value >= 100 else f"{value:.3g}" for value in values]
    axes.bar_label(drawn, shown, padding=3, fontsize=8)
    axes.set_yticks(np.arange(len(bars)), titles, fontsize=8)
    axes.margins(x=0.2)
    axes.invert_yaxis()
    axes.set(
        xscale="log",
        xlabel="median ms",
        title=f"{name}: {network['windows']} windows or one dense pass",
    )
    return figure


def layers_figure(name: str, network: Network) -> Figure:
    """Time of every layer, and the time its arithmetic takes at the rate of matrix products."""
    layers, rate = network["layers"], network["gemm_gflops"]
    figure = Figure(figsize=(8, 0.25 * len(layers) + 1.4), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(layers))
    ideal = [2 * layer["macs"] / rate / 1e6 for layer in layers]
    axes.barh(places, [layer["ms"] for layer in layers], color="#4477aa", label="measured")
    axes.barh(places, ideal, height=0.35, color="#ccbb44", label="at the rate of matrix products")
    names = [f"{layer['name']} ({layer['kind']})" for layer in layers]
    axes.set_yticks(places, names, fontsize=7)
    axes.invert_yaxis()
    axes.legend(fontsize=8)
    axes.set(xlabel="ms", title=f"{name}: where the time goes")
    return figure


def growth_figure(points: Sequence[Point]) -> Figure:
    """Time against everything that can grow, both axes logarithmic; grey: in proportion."""
    done = [point for point in points if point.median_ms is not None]
    names = list(dict.fromkeys(point.axis for point in done))
    networks = dict.fromkeys(point.network for point in done)
    colours = dict(zip(networks, cycle(COLOURS), strict=False))
    figure, grid = make_grid(len(names), 3, (4, 3.2))
    for axes, name in zip(grid, names, strict=True):
        _growth_panel(axes, name, [point for point in done if point.axis == name], colours)
    return figure


def _growth_panel(
    axes: Axes, name: str, points: Sequence[Point], colours: Mapping[str, str]
) -> None:
    for network, part in dict.fromkeys((point.network, point.part) for point in points):
        line = [point for point in points if (point.network, point.part) == (network, part)]
        values = np.array([point.value for point in line])
        axes.loglog(
            values,
            [point.median_ms for point in line],
            PARTS[part],
            marker="o",
            markersize=3,
            color=colours[network],
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
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    if name == "threads":
        axes.set_xticks(values)
    axes.set(xlabel=name, ylabel="median ms")
    axes.legend(fontsize=7)
