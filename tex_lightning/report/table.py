"""The closing table of a run."""

from pathlib import Path
from typing import Any

from rich.table import Table

from tex_lightning.progress import console


def print_results(results: dict[str, Any], directory: Path) -> None:
    """Print one line per network: accuracy with interval and counts, cost beside it."""
    table = Table(title=f"{results['task']} · {results['model']} · {results['data']}")
    for heading in ("network", "votes", "95 % interval", "fragments"):
        table.add_column(heading)
    for heading in ("ms/sample", "fit s", "parameters", "MMAC"):
        table.add_column(heading, justify="right")
    for name, network in results["networks"].items():
        low, high = network["vote_ci95"]
        table.add_row(
            name,
            f"{network['vote_accuracy']:.1%} ({network['correct']}/{network['test_samples']})",
            f"{low:.1%} to {high:.1%}",
            f"{network['fragment_accuracy']:.1%}",
            f"{network['latency_ms']['median']:.1f}",
            f"{network['fit_seconds']:.0f}",
            f"{network['parameters']:,}",
            _millions(network["macs_per_sample"]),
        )
    console.print(table)
    console.print(f"Results in {directory}", soft_wrap=True, highlight=False)


def _millions(macs: int | None) -> str:
    return "not counted" if macs is None else f"{macs / 1e6:,.0f}"
