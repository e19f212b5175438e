"""``report.html`` and ``report.md``: one context of a run folder, rendered twice."""

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tex_lightning.core.files import read_rows, write_text
from tex_lightning.report.document import comparison_tables, read_systems
from tex_lightning.report.table import (
    TINY,
    Table,
    condition_rows,
    facts,
    is_tiny,
    read_or_empty,
    run_overrides,
    run_settings,
)
from tex_lightning.text import render

TEMPLATES = Path(__file__).parent
FILES = ("frontier.csv", "sweep.csv")
NOTES = """\
Votes are decisions on whole samples, fragments those at single positions. Intervals are Wilson's.
p is the exact McNemar test of the row against the best one on the same samples, with the samples
that only the best row and only this row had right. Milliseconds run from decoded recordings to the
label on this machine; fit s is the time of training of all folds of a row."""


def write_report(directory: Path, runs: Sequence[Path] | None = None) -> None:
    """Write ``report.html``, and ``report.md`` for a sweep or a cross-validation.

    All figures are inside the page. Nothing is fetched, and what comes out of files is text, never
    markup.

    Args:
        directory: A run folder, or that of a sweep.
        runs: Run folders of a sweep; None for a single run.
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
        "overrides": run_overrides(directory),
        "notes": NOTES if systems else "",
        "tables": comparison_tables(systems) if compares else _by_condition(results),
        "figures": sorted([*directory.glob("*.png"), *directory.glob("figures/*.png")]),
        "embedded": embedded,
        "directory": directory,
    }
    if systems:
        write_text(directory / "report.md", render(TEMPLATES / "report.md.jinja", context))
    further = {
        "networks": facts(results),
        "files": [_file_table(directory / name) for name in FILES if (directory / name).is_file()],
        "settings": run_settings(directory),
        "environment": results.get("environment", {}),
        "seconds": results.get("wall_seconds"),
    }
    page = render(TEMPLATES / "page.html", {**context, **further})
    write_text(directory / "report.html", page)


def _by_condition(results: Mapping[str, Any]) -> list[Table]:
    """Return the table of votes by condition, if there are any."""
    rows = condition_rows(results.get("networks", {}))
    return [Table("By condition", rows)] if rows else []


def embedded(path: Path) -> str:
    """Return a PNG as a data URI."""
    return f"data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}"


def _file_table(path: Path) -> Table:
    """Return the table of a CSV, figures with four digits."""
    rows = [
        {name.replace("_", " "): _short(cell) for name, cell in line.items()}
        for line in read_rows(path)
    ]
    return Table(path.name, rows)


def _short(cell: str) -> str:
    try:
        number = float(cell)
    except ValueError:
        return cell
    return cell if number == int(number) else f"{number:.4g}"
