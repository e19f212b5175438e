"""The summary of a sweep: table, ``sweep.csv``, charts and page."""

import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from statistics import mean, stdev
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, PercentFormatter

from tex_lightning.core.console import console
from tex_lightning.core.files import write_rows
from tex_lightning.core.run_folder import FAILURE
from tex_lightning.evaluation.conditions import by_size
from tex_lightning.report.figures import save_figure
from tex_lightning.report.page import write_report
from tex_lightning.report.style import Look, brief, looks, styled
from tex_lightning.report.table import FOLD_KEYS, TINY, Table, is_tiny, make_table
from tex_lightning.report.trials import (
    BEST,
    JOB,
    LOSS,
    TrialRow,
    assigned,
    columns,
    failure_tables,
    short,
    short_names,
    shown_rows,
    sweep_rows,
    sweep_table,
    swept_keys,
    told_figures,
)
from tex_lightning_runtime.files import natural_key

MAX_LINES = 6  # combinations of the other keys that have a line each; else they are averaged
MAX_FIGURES = 12
WIDE = 30  # ratio of the largest to the smallest value from which on the axis is logarithmic
OBJECTIVE = f"{LOSS}, the objective"
CLOSE = 1 / 7  # of the axis, below which two numbers beside each other would overlap
APART = 0.01  # of the axis, between the intervals of two lines at one value
TURNED = 24  # characters of all values together, from which on they are written upwards


def summarise(directory: Path, *, searched: bool) -> int:
    """Print and write the results of the jobs of a sweep; return how many rows are not done.

    If ``searched``, a sweeper looked for the least objective.
    """
    marks = [*directory.glob("*/.hydra/overrides.yaml"), *directory.glob(f"*/{FAILURE}")]
    jobs = sorted({directory / mark.relative_to(directory).parts[0] for mark in marks})
    jobs.sort(key=lambda path: natural_key(path.name))
    rows = sweep_rows(jobs, searched=searched)
    keys = swept_keys(rows)
    lines = [{**row, **assigned(row), "overrides": " ".join(row["overrides"])} for row in rows]
    known = columns()
    headings = [*(key for key in keys if key not in known), *known]
    cells = ([line.get(heading) for heading in headings] for line in lines)
    write_rows(directory / "sweep.csv", headings, cells)
    table = sweep_table(rows, searched=searched)
    _print(table, rows, directory)
    draw_sweep(rows, directory, searched=searched)
    write_report(directory, jobs, [table, *failure_tables(rows)])
    return sum(row["status"] != "done" for row in rows)


def _print(table: Table, rows: Sequence[TrialRow], directory: Path) -> None:
    """Print a line for each row that is shown, failures, and where the files are."""
    right = {heading for row in rows for heading in told_figures(row, searched=False)}
    one = len({row["network"] for row in rows if "network" in row}) == 1
    headings = [name for name in table.headings if not (one and name == "network")]
    shown = [name for name in headings if name not in right]
    figures = [name for name in headings if name in right]
    cells = ([row.get(name, "") for name in (*shown, *figures)] for row in table.rows)
    console.print(make_table("sweep", shown, figures, cells))
    for row in rows:
        if row["status"] != "done":
            console.print(f"Job {row[JOB]}: {row['status']}", soft_wrap=True)
    if any(is_tiny(row["overrides"]) for row in rows):
        console.print(TINY, style="bold yellow")
    console.print(f"Summary in {directory / 'sweep.csv'}", soft_wrap=True)


class Point(NamedTuple):
    """The figure of one value of a key, with the ends of its interval."""

    value: str
    figure: float
    low: float
    high: float


def draw_sweep(rows: Sequence[TrialRow], directory: Path, *, searched: bool) -> list[Path]:
    """Save a figure over each swept key as ``figures/sweep_KEY.png`` and return the files.

    Rows are those of :func:`~.trials.sweep_rows`. If ``searched``, the objective of the search is
    drawn in place of the accuracy.
    """
    keys = [key for key in swept_keys(rows) if key not in ("seed", *FOLD_KEYS)]
    names = short_names(keys)
    asked = {(row[JOB], *row["overrides"]): row for row in shown_rows(rows)}  # the last network
    known = [row for row in asked.values() if row.get(_column(searched)) is not None]
    files = []
    for key in keys[:MAX_FIGURES]:
        figure = key_figure(known, key, names, searched=searched)
        if figure is not None:
            name = re.sub(r"[^\w.-]", "_", names[key])
            files.append(save_figure(figure, directory / "figures" / f"sweep_{name}"))
    return files


def _column(searched: bool) -> str:
    return LOSS if searched else "vote_accuracy"


@styled
def key_figure(
    rows: Sequence[TrialRow], key: str, names: dict[str, str], *, searched: bool
) -> Figure | None:
    """Draw the figures of rows over one key; None where fewer than two values have any.

    Rows that agree in all other keys are one line with Wilson's intervals, or the deviation over
    seeds; of many such lines their mean is drawn with its deviation. A search tries each value
    beside other ones of all keys, so that its trials are points.
    """
    column, others = _column(searched), [name for name in names if name != key]
    lines: dict[str, list[Point]] = defaultdict(list)
    for row in rows:
        values = assigned(row)
        if key in values:
            shared = ", ".join(f"{names[k]}={values[k]}" for k in others if k in values)
            lines[shared].append(Point(values[key], *_interval(row, column)))
    order = sorted({x.value for line in lines.values() for x in line}, key=by_size)
    if len(order) < 2:
        return None
    said = ""
    if searched:
        lines = {"": [point for line in lines.values() for point in line]}
        said = "others vary too" if others else ""
    elif len(lines) > MAX_LINES:
        lines, said = {"": _means(lines)}, "mean over " + ", ".join(names[k] for k in others)
    figure = Figure(figsize=(4.6, 3.2), layout="constrained")
    axes = figure.subplots()
    places = _place(axes, order)
    middle = (len(lines) - 1) / 2
    for number, (name, look) in enumerate(looks(lines).items()):
        beside = _moved(axes, places, APART * (number - middle))
        _draw(axes, lines[name], beside, name, look, joined=not searched)
    if searched:
        _star(axes, rows, key, places)
    else:
        axes.yaxis.set_major_formatter(PercentFormatter(1))
    axes.set(xlabel=key, ylabel=OBJECTIVE if searched else "accuracy")
    axes.set_title(brief(names[key]) + (f" ({brief(said)})" if said else ""))
    axes.grid(visible=True)
    if len(lines) > 1 or searched:
        axes.legend(*axes.get_legend_handles_labels(), fontsize=6)
    return figure


def _interval(row: TrialRow, column: str) -> tuple[float, float, float]:
    value = float(row[column])
    if column == LOSS:
        return value, value, value
    if "vote_accuracy_sd" in row:
        return value, value - row["vote_accuracy_sd"], value + row["vote_accuracy_sd"]
    return value, row["ci_low"], row["ci_high"]


def _means(lines: dict[str, list[Point]]) -> list[Point]:
    """Return the mean of each value over all lines, and its standard deviation either way."""
    values: dict[str, list[float]] = defaultdict(list)
    for line in lines.values():
        for point in line:
            values[point.value].append(point.figure)
    spreads = {value: stdev(all_) if len(all_) > 1 else 0.0 for value, all_ in values.items()}
    return [
        Point(value, mean(all_), mean(all_) - spreads[value], mean(all_) + spreads[value])
        for value, all_ in values.items()
    ]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _place(axes: Axes, order: Sequence[str]) -> dict[str, float]:
    """Return where each value is across, and set the axis: numbers to scale, names side by side."""
    if not all(map(_is_number, order)):
        axes.set_xticks(range(len(order)), [brief(value, 20) for value in order])
        if sum(map(len, order)) > TURNED:
            axes.tick_params(axis="x", rotation=90)
        return {value: float(place) for place, value in enumerate(order)}
    places = {value: float(value) for value in order}
    across = np.array([*places.values()])
    if across[0] > 0 and across[-1] / across[0] >= WIDE:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")  # signs of math are off
        across = np.log(across)
    if np.diff(across).min() >= CLOSE * np.ptp(across) * (1 - 1e-9):
        axes.set_xticks([*places.values()], [*map(short, places)])
        axes.xaxis.set_minor_formatter(NullFormatter())
    return places


def _moved(axes: Axes, places: dict[str, float], share: float) -> dict[str, float]:
    """Return places a share of the axis further on, whatever its scale."""
    scale = axes.xaxis.get_transform()
    across = scale.transform(np.array([*places.values()]))
    moved = scale.inverted().transform(across + share * np.ptp(across))
    return dict(zip(places, moved.tolist(), strict=True))


def _draw(
    axes: Axes, points: Sequence[Point], places: dict[str, float], name: str, look: Look, *,
    joined: bool,
) -> None:  # fmt: skip
    scaled = all(map(_is_number, places))  # a line between names means nothing
    points = sorted(points, key=lambda point: places[point.value])
    across = [places[point.value] for point in points]
    # an interval of a mean need not reach both ways, and rounding may pass the figure
    below = [max(0.0, point.figure - point.low) for point in points]
    above = [max(0.0, point.high - point.figure) for point in points]
    axes.errorbar(
        across, [point.figure for point in points], yerr=None if not joined else (below, above),
        color=look.colour, marker=look.marker, linestyle="-" if joined and scaled else "none",
        capsize=2, label=brief(name) or ("trial" if not joined else None),
    )  # fmt: skip


def _star(axes: Axes, rows: Sequence[TrialRow], key: str, places: dict[str, float]) -> None:
    for row in rows:
        if row.get(BEST) and key in assigned(row):
            across = places[assigned(row)[key]]
            axes.plot(across, float(row[LOSS]), "*", color="#d55e00", markersize=12, label=BEST)
