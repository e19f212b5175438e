"""Table and figures of ``task=profile``."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.table import Table

from tex_lightning.profiling.growth import Point
from tex_lightning.progress import console
from tex_lightning.report.paper import paper_table

Network = dict[str, Any]

WAYS = {
    "sliding_window": "CNN, windows one by one",
    "batched_window": "CNN, windows in batches",
    "same_engine_window": "same, windows through the FCN's engine",
    "reference": "FCN as trained",
    "fcn": "FCN accelerated",
    "fcn_bf16": "FCN accelerated, bf16",
    "features": "features",
}
COLOURS = {"haptic": "#4477aa", "visual": "#ee6677", "fusion": "#228833"}
PARTS = {"label": "-", "network": "-", "features": ":"}
SHOWN_LAYERS = 8


def _factor(key: str) -> Callable[[Network], str]:
    return lambda network: f"{network[key]:.1f}x" if key in network else ""


def _agreement(network: Network) -> str:
    return f"{network['label_agreement']:.2%} / {network['dense_agreement']:.2%}"


def _flips(name: str) -> Callable[[Network], str]:
    def cell(network: Network) -> str:
        if f"flips_{name}" not in network:
            return ""
        vote = "another vote" if network[f"vote_flips_{name}"] else "same vote"
        return f"{network[f'flips_{name}']} of {network['positions']}, {vote}"

    return cell


def _memory(network: Network) -> str:
    peak = network["peak_memory_mib"]
    return "" if peak is None else f"{peak:,.0f} MiB"


FACTS: dict[str, Callable[[Network], str]] = {
    "speedup over windows one by one": _factor("speedup"),
    "speedup over windows, same engine": _factor("speedup_same_engine"),
    "ratio of their arithmetic": _factor("arithmetic_ratio"),
    "speedup in bf16": _factor("speedup_bf16"),
    "accelerated over as trained": _factor("engine_gain"),
    "windows": lambda network: str(network["windows"]),
    "labels equal: window alone / dense": _agreement,
    "labels that the engine changes": _flips("engine"),
    "labels that bf16 changes": _flips("bf16"),
    "MMAC": lambda network: f"{network['macs'] / 1e6:,.0f}",
    "matrix products, GFLOP/s": lambda network: f"{network['gemm_gflops']:.0f}",
    "share of that rate": lambda network: f"{network['roofline_fraction']:.0%}",
    "peak memory of a pass": _memory,
}


def print_profile(results: dict[str, Any], directory: Path) -> None:
    """Print our figures beside the paper's, then the layers that take longest."""
    networks, paper = results["networks"], paper_table("profiling")
    weights = results["weights"]
    caption = f"ms: median (p95), {results['environment']['threads']} threads; paper: its average "
    caption += f"on a {paper['device']}"
    table = Table(title=f"profile · {results['model']} · {weights}", caption=caption)
    table.add_column("")
    for name in networks:
        table.add_column(name, justify="right")
        table.add_column("paper", justify="right", style="dim")
    for key, title in WAYS.items():
        if any(f"{key}_ms" in network for network in networks.values()):
            cells = ((_time(networks[name], key), _time(paper[name], key)) for name in networks)
            table.add_row(title, *(cell for pair in cells for cell in pair))
    for title, fact in FACTS.items():
        table.add_row(title, *(cell for name in networks for cell in (fact(networks[name]), "")))
    console.print(table)
    for name, network in networks.items():
        _print_layers(name, network)
    console.print(f"Results in {directory}", soft_wrap=True, highlight=False)


def _time(network: Network, key: str) -> str:
    if f"{key}_ms" not in network:
        return ""
    p95 = f" ({network[f'{key}_p95_ms']:,.1f})" if f"{key}_p95_ms" in network else ""
    return f"{network[f'{key}_ms']:,.1f}{p95}"


def _print_layers(name: str, network: Network) -> None:
    table = Table(title=f"{name}: the {SHOWN_LAYERS} layers that take longest")
    for heading in ("layer", "kind"):
        table.add_column(heading)
    for heading in ("ms", "MMAC", "GFLOP/s", "share of matrix products"):
        table.add_column(heading, justify="right")
    for layer in sorted(network["layers"], key=lambda layer: -layer["ms"])[:SHOWN_LAYERS]:
        table.add_row(
            layer["name"],
            layer["kind"],
            f"{layer['ms']:.2f}",
            f"{layer['macs'] / 1e6:,.0f}",
            f"{layer['gflops']:.0f}",
            f"{layer['roofline_fraction']:.0%}",
        )
    console.print(table)


def ways_figure(name: str, network: Network) -> Figure:
    """Bars of all ways to classify one recording, on a logarithmic axis, the paper's below."""
    paper = paper_table("profiling")
    bars = [
        (title, network[f"{key}_ms"], "#4477aa")
        for key, title in WAYS.items()
        if f"{key}_ms" in network
    ]
    bars += [
        (f"paper: {WAYS[key]} ({paper['device']})", paper[name][f"{key}_ms"], "#bbbbbb")
        for key in ("sliding_window", "fcn")
    ]  # fmt: skip
    figure = Figure(figsize=(8, 0.4 * len(bars) + 1.2), layout="constrained")
    axes = figure.subplots()
    _bars(axes, bars)
    axes.set(
        xscale="log",
        xlabel="median ms",
        title=f"{name}: {network['windows']} windows or one dense pass",
    )
    return figure


def _bars(axes: Axes, bars: Sequence[tuple[str, float, str]]) -> None:
    titles, values, colours = zip(*bars, strict=True)
    drawn = axes.barh(np.arange(len(bars)), values, color=colours)
    axes.bar_label(drawn, [f"{value:.3g}" for value in values], padding=3, fontsize=8)
    axes.set_yticks(np.arange(len(bars)), titles, fontsize=8)
    axes.margins(x=0.12)
    axes.invert_yaxis()


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


def write_growth(points: Sequence[Point], path: Path) -> None:
    """Write one line per measurement as CSV; what was left out has a note and no time."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(entry.name for entry in fields(Point))
        writer.writerows(astuple(point) for point in points)


def left_out(points: Sequence[Point]) -> list[str]:
    """A line for each series that ends early, with the first value that was left out."""
    first: dict[tuple[str, str, str], Point] = {}
    for point in points:
        if point.note:
            first.setdefault((point.axis, point.network, point.part), point)
    return [
        f"{' '.join(series[1:])} against {series[0]}: left out from {point.value:g} on "
        f"({point.note})."
        for series, point in first.items()
    ]


def growth_figure(points: Sequence[Point]) -> Figure:
    """Time against everything that can grow, both axes logarithmic; grey is in proportion."""
    done = [point for point in points if point.median_ms is not None]
    names = list(dict.fromkeys(point.axis for point in done))
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(4 * columns, 3.2 * rows), layout="constrained")
    grid = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    for axes, name in zip(grid, names, strict=False):
        _growth_panel(axes, name, [point for point in done if point.axis == name])
    for axes in grid[len(names) :]:
        axes.set_axis_off()
    return figure


def _growth_panel(axes: Axes, name: str, points: Sequence[Point]) -> None:
    for network, part in dict.fromkeys((point.network, point.part) for point in points):
        line = [point for point in points if (point.network, point.part) == (network, part)]
        values = np.array([point.value for point in line])
        axes.loglog(
            values,
            [point.median_ms for point in line],
            PARTS[part],
            marker="o",
            markersize=3,
            color=COLOURS[network],
            label=f"{network} {part}",
        )
    last = max(points, key=lambda point: point.median_ms or 0)
    values = np.array(sorted({point.value for point in points}))
    axes.loglog(values, (last.median_ms or 0) * values / last.value, color="#dddddd", zorder=0)
    axes.set(xlabel=name, ylabel="median ms")
    axes.legend(fontsize=7)
