"""Tables of ``task=profile``."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from tex_lightning.evaluation.outcomes import RANDOM
from tex_lightning.files import write_lines
from tex_lightning.profiling.growth import Point
from tex_lightning.report.paper import paper_table
from tex_lightning.report.table import make_table, print_tables

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
    """Print each network's figures, beside the paper's if it has them, then its slow layers."""
    tables = []
    for name, network in results["networks"].items():
        tables += [_comparison(name, network, results), _layers(name, network)]
    print_tables(directory, *tables)


def _comparison(name: str, network: Network, results: dict[str, Any]) -> Table:
    """One network's ways of classifying, beside the paper's if it has that network."""
    paper = paper_table("profiling")
    theirs = paper.get(name)
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


def _layers(name: str, network: Network) -> Table:
    title = f"{name}: the {SHOWN_LAYERS} layers that take longest"
    table = make_table(title, ["layer", "kind"], ["ms", "MMAC", "GFLOP/s", "share"])
    table.caption = "share: of the rate of matrix products"
    for layer in sorted(network["layers"], key=lambda layer: -layer["ms"])[:SHOWN_LAYERS]:
        table.add_row(
            layer["name"],
            layer["kind"],
            f"{layer['ms']:.2f}",
            f"{layer['macs'] / 1e6:,.0f}",
            f"{layer['gflops']:.0f}",
            f"{layer['roofline_fraction']:.0%}",
        )
    return table


def write_growth(points: Sequence[Point], path: Path) -> None:
    """Write one line per measurement as CSV; what was left out has a note and no time."""
    write_lines(path, Point, points)


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
