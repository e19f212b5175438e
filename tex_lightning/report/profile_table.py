"""Table of ``task=profile``."""

from pathlib import Path
from typing import Any

from rich.table import Table

from tex_lightning.evaluation.outcomes import RANDOM
from tex_lightning.report.table import make_table, paper_table, print_tables

Network = dict[str, Any]

WAYS = {
    "sliding_window": "CNN, windows one by one",
    "same_engine_window": "same, windows through the FCN's engine",
    "reference": "FCN as trained",
    "fcn": "FCN accelerated",
}
FACTS = {  # format of each figure by its key
    "speedup": ("speedup over windows, as trained", "{:.1f}x"),
    "speedup_same_engine": ("speedup over windows, same engine", "{:.1f}x"),
    "arithmetic_ratio": ("ratio of their arithmetic", "{:.1f}x"),
    "engine_speedup": ("accelerated over as trained", "{:.1f}x"),
    "windows": ("windows", "{}"),
    "label_agreement": ("labels as on the window alone", "{:.2%}"),
    "macs": ("multiply-accumulates", "{:,}"),
    "gemm_gflops": ("matrix products, GFLOP/s", "{:.0f}"),
    "roofline_fraction": ("share of that rate", "{:.0%}"),
}


def print_profile(results: dict[str, Any], directory: Path) -> None:
    """Print each network's figures, beside the paper's if it has them."""
    networks = results["networks"].items()
    print_tables(directory, *(_comparison(name, network, results) for name, network in networks))


def _comparison(name: str, network: Network, results: dict[str, Any]) -> Table:
    """One network's ways of classifying, as built beside the paper's if it has that network."""
    paper = paper_table("profiling")
    theirs = paper.get(name, {}) if results["weights"] == RANDOM else {}  # not of one's own data
    title = f"profile · {results['model']} · {results['weights']}"
    table = make_table(title, [""], [name, "paper"] if theirs else [name])
    table.caption = f"ms: median (p95), threads: {results['environment']['threads']}"
    for key, way in WAYS.items():
        ours = f"{network[f'{key}_ms']:,.1f} ({network[f'{key}_p95_ms']:,.1f})"
        table.add_row(way, ours, *([f"{theirs.get(f'{key}_ms', '')}"] if theirs else []))
    for key, (fact, form) in FACTS.items():
        table.add_row(fact, form.format(network[key]))
    return table
