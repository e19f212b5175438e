"""Chart and printed table of ``task=frontier``."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, PercentFormatter

from tex_lightning.core.console import console, say
from tex_lightning.report.style import brief, looks, styled
from tex_lightning.report.table import make_table, print_tables

Row = Mapping[str, Any]  # of ``frontier.csv``, by column


@styled
def frontier_figure(rows: Sequence[Row]) -> Figure:
    """Draw accuracy with intervals over latency (log axis).

    Dominated systems are hollow, the chosen one has a black edge.
    """
    figure = Figure(figsize=(11, 6), layout="constrained")
    axes = figure.subplots()
    drawn = looks(row["system"] for row in rows)
    for row in rows:
        look = drawn[row["system"]]
        bounds = [
            [max(row["vote_accuracy"] - row["ci_low"], 0)],
            [max(row["ci_high"] - row["vote_accuracy"], 0)],
        ]
        axes.errorbar(
            row["latency_ms_mean"], row["vote_accuracy"], bounds, color=look.colour, capsize=2,
            marker=look.marker, markersize=8, markeredgecolor="black" if row["chosen"] else None,
            markerfacecolor=look.colour if row["on_frontier"] else "white",
            label=brief(row["system"]) + (" (chosen)" if row["chosen"] else ""),
        )  # fmt: skip
    best = [row for row in rows if row["on_frontier"]]
    line = sorted((row["latency_ms_mean"], row["vote_accuracy"]) for row in best)
    axes.plot(*np.transpose(line), "k--", linewidth=0.8, drawstyle="steps-post")
    axes.set(
        xscale="log",
        xlabel="ms for one sample, features included (mean over samples)",
        ylabel="vote accuracy with Wilson's 95 % interval",
        title="Accuracy against latency",
    )
    axes.yaxis.set_major_formatter(PercentFormatter(1))
    for axis_formatter in (axes.xaxis.set_major_formatter, axes.xaxis.set_minor_formatter):
        axis_formatter(LogFormatter(minor_thresholds=(2, 0.5)))
    axes.grid(which="both")
    figure.legend(loc="outside right center")
    return figure


def print_frontier(
    rows: Sequence[Row], procedure: Mapping[str, Any] | None, directory: Path, command: str
) -> None:
    """Print one line per system, what to expect of the choice, and how to train the chosen one.

    Args:
        rows: The systems, fastest first.
        procedure: ``procedure`` of ``results.json``; None of a single fold.
        directory: The run folder.
        command: The command that trains the chosen system.
    """
    table = make_table("frontier", ["system"], ["votes", "95 % CI", "ms", "fit s", "parameters"])
    table.caption = "ms: mean of one sample"
    for row in rows:
        table.add_row(
            row["system"] + (" (chosen)" if row["chosen"] else ""),
            f"{row['vote_accuracy']:.1%}",
            f"{100 * row['ci_low']:.1f}-{100 * row['ci_high']:.1f}",
            f"{row['latency_ms_mean']:.1f}",
            f"{row['fit_seconds']:.1f}",
            f"{row['parameters']:,}",
            style=None if row["on_frontier"] else "dim",
        )
    console.print(table)
    (chosen,) = (row for row in rows if row["chosen"])
    if procedure is not None:
        say(
            f"Expect {procedure['vote_accuracy']:.1%} of such a choice: each fold by the system "
            "chosen on the others."
        )
    say(
        f"{chosen['system']} is chosen on all votes, so its own {chosen['vote_accuracy']:.1%} is "
        "optimistic, and holds for these classes."
    )
    say(f"Train it with: {command}", wraps=False)
    print_tables(directory)
