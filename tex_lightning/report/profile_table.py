"""Table and chart of ``task=profile``."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from tex_lightning.evaluation.outcomes import RANDOM
from tex_lightning.report.style import GUIDE, colour_of, styled
from tex_lightning.report.table import make_table, paper_table, print_tables

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


def _factor(key: str) -> Callable[[Network], str]:
    return lambda network: f"{network[key]:.1f}x" if key in network else ""


def _share(key: str, digits: int) -> Callable[[Network], str]:
    return lambda network: f"{network[key]:.{digits}%}"


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


SPEEDUP = "speedup over windows, as trained"
DENSE_LABELS = "labels as in the dense pass"

FACTS: dict[str, Callable[[Network], str]] = {
    SPEEDUP: _factor("speedup"),
    "speedup over windows, same engine": _factor("speedup_same_engine"),
    "ratio of their arithmetic": _factor("arithmetic_ratio"),
    "accelerated over as trained": _factor("engine_speedup"),
    "windows": lambda network: str(network["windows"]),
    "labels as on the window alone": _share("label_agreement", 2),
    DENSE_LABELS: _share("dense_agreement", 2),
    "labels that the engine changes": _flips("engine"),
    "labels that bf16 changes": _flips("bf16"),
    "MMAC": lambda network: f"{network['macs'] / 1e6:,.0f}",
    "matrix products, GFLOP/s": lambda network: f"{network['gemm_gflops']:.0f}",
    "share of that rate": _share("roofline_fraction", 0),
    "peak memory of a pass": _memory,
}


def print_profile(results: dict[str, Any], directory: Path) -> None:
    """Print each network's figures, beside the paper's if it has them."""
    networks = results["networks"].items()
    print_tables(directory, *(_comparison(name, network, results) for name, network in networks))


def _comparison(name: str, network: Network, results: dict[str, Any]) -> Table:
    """One network's ways of classifying, as built beside the paper's if it has that network."""
    paper = paper_table("profiling")
    theirs = paper.get(name) if results["weights"] == RANDOM else None  # not of one's own data
    title = f"profile · {results['model']} · {results['weights']}"
    table = make_table(title, [""], [name, "paper"] if theirs else [name])
    table.caption = f"ms: median (p95), threads: {results['environment']['threads']}"
    columns = [network]
    if theirs:
        theirs["speedup"] = theirs["sliding_window_ms"] / theirs["fcn_ms"]
        table.caption += f"; paper: its average on a {paper['device']}"
        columns.append(theirs)
    for key, way in WAYS.items():
        if f"{key}_ms" in network:
            table.add_row(way, *(_time(column, key) for column in columns))
    for key, fact in FACTS.items():
        if key == DENSE_LABELS and results["weights"] == RANDOM:
            continue  # random weights say nearly the same everywhere: chance decides
        table.add_row(key, *map(fact, columns if key == SPEEDUP else [network]))
    return table


def _time(network: Network, key: str) -> str:
    if f"{key}_ms" not in network:
        return ""
    p95 = f" ({network[f'{key}_p95_ms']:,.1f})" if f"{key}_p95_ms" in network else ""
    return f"{network[f'{key}_ms']:,.1f}{p95}"


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
