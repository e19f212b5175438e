"""``report.html`` and ``report.md``: one context of a run folder, rendered twice."""

import math
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from tex_lightning.core.files import read_rows, write_text
from tex_lightning.report.document import comparison_tables, read_systems
from tex_lightning.report.page_media import embedded, shown_samples
from tex_lightning.report.style import colour_of
from tex_lightning.report.table import (
    TINY,
    Table,
    facts,
    is_tiny,
    read_or_empty,
    rerun_command,
    run_overrides,
    run_settings,
)
from tex_lightning.text import render

TEMPLATES = Path(__file__).parent
METRICS = {
    "train/loss": "training loss",
    "train/fragment_accuracy": "fragment accuracy in training",
    "val/loss": "validation loss",
    "val/vote_accuracy": "validation votes",
}
FILES = ("frontier.csv", "breaking_points.csv", "conditions.csv", "sweep.csv")
MOST_LINES = 200  # of a file that are shown
NOTES = """\
Votes are decisions on whole samples, fragments those at single positions. Intervals are Wilson's.
p is the exact McNemar test of the row against the best one on the same samples, with the samples
that only the best row and only this row had right. Milliseconds run from decoded recordings to the
label on this machine; fit s is the time of training of all folds of a row."""
Curve = dict[str, Any]


def write_report(
    directory: Path, runs: Sequence[Path] | None = None, command: str | None = None
) -> None:
    """Write ``report.html``, and ``report.md`` for a sweep or a cross-validation.

    Everything is inside of the page: pictures, and the recordings of the worst samples, small.
    Nothing is fetched, and what comes out of files is text, never markup.

    Args:
        directory: A run folder, or that of a sweep.
        runs: Run folders of a sweep; None for a single run.
        command: What repeats it; None takes what the run folder says.
    """
    results = read_or_empty(directory / "results.json")
    folders = [directory] if runs is None else runs
    compares = runs is not None or results.get("task") == "crossval"
    systems = read_systems(folders) if compares else []
    names = [str(results[key]) for key in ("task", "model", "data") if results.get(key)]
    tiny = any(is_tiny(run_overrides(each)) for each in folders)
    context = {
        "title": " · ".join(names) or directory.name,
        "tiny": TINY if tiny else "",
        "command": command or rerun_command(directory),
        "notes": NOTES if systems else "",
        "tables": comparison_tables(systems),
        "figures": sorted([*directory.glob("*.png"), *directory.glob("figures/*.png")]),
        "embedded": embedded,
        "directory": directory,
    }
    if systems:
        write_text(directory / "report.md", render(TEMPLATES / "report.md.jinja", context))
    networks = facts(results)
    further = {
        "networks": networks,
        "colours": {name: colour_of(name) for name in networks},
        "curves": read_curves(directory),
        "files": [_file_table(directory / name) for name in FILES if (directory / name).is_file()],
        "samples": shown_samples(directory, list(networks)),
        "settings": run_settings(directory),
        "environment": results.get("environment", {}),
        "seconds": results.get("wall_seconds"),
    }
    page = render(TEMPLATES / "page.html", {**context, **further})
    write_text(directory / "report.html", page)


def _file_table(path: Path) -> Table:
    """The first lines of a CSV, figures with four digits."""
    lines = read_rows(path)
    rows = [
        {name.replace("_", " "): _short(cell) for name, cell in line.items()}
        for line in lines[:MOST_LINES]
    ]
    left_out = len(lines) - len(rows)
    return Table(path.name, rows, f"{left_out} more lines are in the file." if left_out else "")


def _short(cell: str) -> str:
    try:
        number = float(cell)
    except ValueError:
        return cell
    return cell if number == int(number) else f"{number:.4g}"


def read_curves(directory: Path) -> list[Curve]:
    """The metrics of a run by epoch, means over steps; of a cross-validation its first fold's.

    Returns:
        Network, metric, values, and the corners of a line in a box of 560 by 150.
    """
    own = sorted(directory.glob("metrics/*/metrics.csv"))
    folds = sorted(directory.glob("folds/*/metrics/*/metrics.csv"))
    curves: list[Curve] = []
    for path in own or [each for each in folds if each.parts[-4] == folds[0].parts[-4]]:
        values: dict[str, dict[int, list[float]]] = defaultdict(lambda: defaultdict(list))
        for line in read_rows(path):
            for key in METRICS:
                if line.get(key) and line.get("epoch"):
                    values[key][int(line["epoch"])].append(float(line[key]))
        for key, epochs in values.items():
            means = [fmean(epochs[epoch]) for epoch in sorted(epochs)]
            if len(means) > 1:
                curve = {"network": path.parent.name, "metric": METRICS[key], "values": means}
                curves.append({**curve, "points": _corners(means)})
    return curves


def _corners(values: Sequence[float], width: int = 560, height: int = 150) -> str:
    """Points of a polyline; a value that is not finite has none."""
    finite = [value for value in values if math.isfinite(value)]
    low = min(finite, default=0.0)
    span = (max(finite, default=1.0) - low) or 1
    return " ".join(
        f"{index / (len(values) - 1) * width:.1f},{height - (value - low) / span * height:.1f}"
        for index, value in enumerate(values)
        if math.isfinite(value)
    )
