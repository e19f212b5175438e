"""The chart and the table of ``task=frontier``: accuracy of every system beside its time."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from tex_lightning.core.console import console, say
from tex_lightning.evaluation.metrics import METRICS
from tex_lightning.report.style import COLOURS, brief, styled
from tex_lightning.report.table import make_table, print_tables

FrontierRow = Mapping[str, Any]  # of ``frontier.csv``, by column
GREY = "#6b6b6b"  # of what another system beats in both
ROW = 0.27  # inches
LONGEST = 70  # characters of a name
LINE = 26  # characters of a line of it
TALL = 1.35  # times the height of a row where names have two lines
BLUE = "blue: no other system is both more accurate and faster"
NEAR = 0.2  # of chance to the least accuracy
ROOM = 1.22  # times the longest bar, for its number


@styled
def frontier_figure(rows: Sequence[FrontierRow], title: str, chance: float) -> Figure:
    """Draw a row for each system: accuracy with interval on the left, time on the right.

    The most accurate system is on top, and among equals the fastest. Systems that another one beats
    in both are grey; the chosen one is orange and said to be. Chance, the accuracy of guessing, is
    drawn as a line if it is not far from all.
    """
    systems = sorted(rows, key=lambda row: (-row["vote_accuracy"], row["latency_ms_mean"]))
    whole = [brief(row["name"], LONGEST) + " (chosen)" * row["chosen"] for row in systems]
    # in lines so short that a phone shows the figures beside them
    names = [fill(name, LINE, break_on_hyphens=False) for name in whole]
    height = 1.1 + ROW * len(systems) * (1 if max(map(len, names)) < LINE else TALL)
    figure = Figure(figsize=(7, height), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(5, 4))
    for place, row in enumerate(systems):
        _draw_row(left, right, place, row)
    left.set_yticks(range(len(systems)), names)
    for label, row in zip(left.get_yticklabels(), systems, strict=True):
        label.set_color(_colour(row))
        label.set_fontweight("bold" if row["chosen"] else "normal")
    least = min(row["ci_low"] for row in systems)
    if chance > least - NEAR:
        least = min(chance, least)
        left.axvline(chance, color=GREY, linestyle=":", linewidth=0.8)
    left.set(xlim=(least - 0.02, 1.0 + 0.2 * (1 - least)), ylim=(len(systems) - 0.4, -1))
    left.set_xticks([tick for tick in left.get_xticks() if least - 0.02 <= tick <= 1.001])
    left.xaxis.set_major_formatter(PercentFormatter(1, decimals=0))
    left.set_title("recording accuracy with 95 % interval", loc="left")
    right.set_xlim(0, ROOM * max(row["latency_ms_mean"] for row in systems))
    right.set_title("mean ms for one sample", loc="left")
    for axes in (left, right):
        axes.grid(axis="x")
        axes.set_axisbelow(True)
        axes.tick_params(axis="y", length=0)
        axes.spines[["top", "right", "left"]].set_visible(False)
    figure.suptitle(f"{title}, chance {chance:.1%}\n{BLUE}", fontsize=9)
    return figure


def _colour(row: FrontierRow) -> str:
    if row["chosen"]:
        return COLOURS[4]
    return COLOURS[0] if row["on_frontier"] else GREY


def _draw_row(left: Axes, right: Axes, place: int, row: FrontierRow) -> None:
    colour, accuracy = _colour(row), row["vote_accuracy"]
    spread = [[max(accuracy - row["ci_low"], 0)], [max(row["ci_high"] - accuracy, 0)]]
    left.errorbar(accuracy, place, xerr=spread, color=colour, marker="o", capsize=2.5)
    left.text(
        1.02, place, f"{accuracy:.1%}", va="center", color=colour, fontsize=7,
        transform=left.get_yaxis_transform(), ha="right",
    )  # fmt: skip
    right.barh(place, row["latency_ms_mean"], height=0.55, color=colour)
    time = f" {float(format(row['latency_ms_mean'], '.3g')):,g}"
    right.text(row["latency_ms_mean"], place, time, va="center", color=colour, fontsize=7)


def print_frontier(rows: Sequence[FrontierRow], directory: Path, command: str) -> None:
    """Print one line per system, and how to train the chosen one."""
    table = make_table("frontier", ["system"], ["accuracy", "95 % CI", "ms", "fit s", "parameters"])
    table.caption = "ms: mean of one sample"
    for row in rows:
        table.add_row(
            row["name"] + (" (chosen)" if row["chosen"] else ""),
            METRICS["vote_accuracy"].text(row["vote_accuracy"]),
            f"{100 * row['ci_low']:.1f}-{100 * row['ci_high']:.1f}",
            f"{row['latency_ms_mean']:.1f}",
            METRICS["fit_seconds"].text(row["fit_seconds"]),
            METRICS["parameters"].text(row["parameters"]),
            style=None if row["on_frontier"] else "dim",
        )
    console.print(table)
    (chosen,) = (row for row in rows if row["chosen"])
    say(
        f"{chosen['name']} is chosen on all tested samples, so its own accuracy of "
        f"{chosen['vote_accuracy']:.1%} is optimistic, and holds for these classes."
    )
    say(f"Train it with: {command}", wraps=False)
    print_tables(directory)
