"""``report.html`` and ``report.md``: one context of a run folder, rendered twice."""

import base64
import hashlib
import shlex
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from PIL import Image

from tex_lightning.config.overrides import given_overrides
from tex_lightning.core.files import read_rows, write_text
from tex_lightning.core.run_folder import RESULTS, read_results
from tex_lightning.report.data_page import FOLDER, data_tables
from tex_lightning.report.misclassified import class_tables, embedded, error_cards
from tex_lightning.report.systems import NOTES, comparison_tables, read_systems
from tex_lightning.report.table import (
    TINY,
    Table,
    condition_rows,
    facts,
    is_tiny,
    profile_table,
    run_overrides,
    run_settings,
    typed_overrides,
)
from tex_lightning.text import render

TEMPLATES = Path(__file__).parent
BROAD = 800  # pixels; a figure of more has a row of the page for itself
FILES = ("frontier.csv", "stability.csv")


def write_report(
    directory: Path, runs: Sequence[Path] | None = None, first: Sequence[Table] = ()
) -> None:
    """Write ``report.html``, and ``report.md`` for a sweep or a cross-validation.

    All figures are inside the page. Nothing is fetched, and what comes out of files is text, never
    markup. The ``runs`` are those of a sweep, None for a single one; the ``first`` tables stand
    before all others.
    """
    results = read_results(directory)
    draw_learning(directory)
    folders = [directory] if runs is None else runs
    compares = runs is not None or results.get("task") == "crossval"
    systems = read_systems(folders) if compares else []
    names = [str(results[key]) for key in ("task", "model", "data") if results.get(key)]
    tiny = any(is_tiny(run_overrides(folder)) for folder in folders)
    typed = typed_overrides(directory)
    if runs is not None:
        typed = ["-m", *given_overrides(directory / "0")]  # as of any of its jobs
    script = (TEMPLATES / "page.js").read_text(encoding="utf-8")
    context = {
        "title": " · ".join(names) or directory.name,
        "tiny": TINY if tiny else "",
        "command": shlex.join(["python", "-m", "tex_lightning", *typed]),
        "notes": NOTES if systems else "",
        "tables": [*first, *(comparison_tables(systems) if compares else _own_tables(results))],
        "figures": _figures(directory, results.get("networks", {})),
        "data": data_tables(directory),
        "examples": sorted((directory / FOLDER).glob("*.png")),
        "embedded": embedded,
        "is_broad": is_broad,
        "directory": directory,
        "networks": facts(results),
        "long_tables": [
            *class_tables(directory),
            *_file_tables(directory, results.get("systems", {})),
        ],
        "errors": error_cards(directory),
        "date": _date(directory),
        "script": script,
        "script_hash": base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        "settings": run_settings(directory),
        "environment": results.get("environment", {}),
        "seconds": results.get("wall_seconds"),
    }
    if systems:
        write_text(directory / "report.md", render(TEMPLATES / "report.md.jinja", context))
    write_text(directory / "report.html", render(TEMPLATES / "page.html", context))


def draw_learning(directory: Path) -> None:
    """Save the learning curves of the networks of a run, if any took several epochs."""
    networks = read_results(directory).get("networks", {})
    curves = {}
    for name in networks:
        rows: dict[float, dict[str, float]] = {}
        files = [  # of a run that was interrupted there are several
            file
            for folders in (name, f"{name}_resumed*")
            for file in sorted((directory / "metrics").glob(f"{folders}/metrics.csv"))
        ]
        for file in files:
            for line in read_rows(file):
                known = {key: float(cell) for key, cell in line.items() if cell}
                if "epoch" in known:
                    rows.setdefault(known["epoch"], {}).update(known)
        if len(rows) > 1:
            curves[name] = [rows[epoch] for epoch in sorted(rows)]
    if curves:
        from tex_lightning.report.figures import learning_figure, save_figure  # slow to import

        save_figure(learning_figure(curves), directory / "figures" / "learning_curves")


def _figures(directory: Path, networks: Iterable[str]) -> list[Path]:
    """Return the figures of a run: of all networks, then of each in the order of reading."""
    order = [*networks]
    files = sorted([*directory.glob("*.png"), *directory.glob("figures/*.png")])

    def place(file: Path) -> int:
        return next((n for n, name in enumerate(order) if file.stem.startswith(f"{name}_")), -1)

    return sorted(files, key=place)


def _date(directory: Path) -> str:
    """Return when a run has ended, by its results."""
    file = directory / RESULTS
    if not file.is_file():
        return ""
    return f"{datetime.fromtimestamp(file.stat().st_mtime).astimezone():%Y-%m-%d %H:%M %Z}"


def _own_tables(results: Mapping[str, Any]) -> list[Table]:
    """Return the table of first failures, of a profile or of accuracy by condition, if any."""
    if results.get("task") == "profile":
        return [profile_table(results["networks"])]
    if "failures" in results:
        from tex_lightning.report.stability_charts import failure_table  # Matplotlib is slow

        return [failure_table(results)]
    rows = condition_rows(results.get("networks", {}))
    return [Table("By condition", rows)] if rows else []


def is_broad(path: Path) -> bool:
    """Return whether a picture is too wide for two in a row."""
    with Image.open(path) as picture:  # of which the header is read
        return picture.width > BROAD


def _file_tables(directory: Path, systems: Mapping[str, Mapping[str, Any]]) -> list[Table]:
    """Return the tables of CSVs, figures with four digits and names of systems first."""
    names = {key: str(entry["name"]) for key, entry in systems.items()}
    tables = []
    for path in (directory / name for name in FILES if (directory / name).is_file()):
        rows = [
            {"name": names.get(line.get("system", ""), "")}
            | {name.replace("_", " "): _short(cell) for name, cell in line.items()}
            for line in read_rows(path)
        ]
        tables.append(Table(path.name, rows))
    return tables


def _short(cell: str) -> str:
    try:
        number = float(cell)
    except ValueError:
        return cell
    return cell if number.is_integer() else f"{number:.4g}"
