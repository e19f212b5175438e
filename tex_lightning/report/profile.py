"""Tables of ``task=profile``."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any

from rich.table import Table

from tex_lightning.profiling.growth import Point
from tex_lightning.progress import console
from tex_lightning.report.paper import paper_table
from tex_lightning.report.results import RANDOM

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
SHOWN_LAYERS = 8


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


def _nothing(_: Network) -> str:
    return ""


SPEEDUP = "speedup over windows one by one"
DENSE_LABELS = "labels as in the dense pass"

FACTS: dict[str, Callable[[Network], str]] = {
    SPEEDUP: _factor("speedup"),
    "speedup over windows, same engine": _factor("speedup_same_engine"),
    "ratio of their arithmetic": _factor("arithmetic_ratio"),
    "speedup in bf16": _factor("speedup_bf16"),
    "accelerated over as trained": _factor("engine_gain"),
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
    """Print our figures beside the paper's, then the layers that take longest."""
    networks, paper = results["networks"], paper_table("profiling")
    for name in networks:
        paper[name]["speedup"] = paper[name]["sliding_window_ms"] / paper[name]["fcn_ms"]
    caption = f"ms: median (p95), {results['environment']['threads']} threads; paper: its average "
    caption += f"on a {paper['device']}"
    table = Table(title=f"profile · {results['model']} · {results['weights']}", caption=caption)
    table.add_column("")
    for name in networks:
        table.add_column(name, justify="right")
        table.add_column("paper", justify="right", style="dim")
    for key, title in WAYS.items():
        if any(f"{key}_ms" in network for network in networks.values()):
            cells = ((_time(networks[name], key), _time(paper[name], key)) for name in networks)
            table.add_row(title, *(cell for pair in cells for cell in pair))
    for title, fact in FACTS.items():
        if title == DENSE_LABELS and results["weights"] == RANDOM:
            continue  # random weights say nearly the same everywhere: chance decides
        paper_fact = fact if title == SPEEDUP else _nothing
        cells = ((fact(networks[name]), paper_fact(paper[name])) for name in networks)
        table.add_row(title, *(cell for pair in cells for cell in pair))
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
