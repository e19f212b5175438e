"""Write ``report.html`` from what a run folder holds."""

import csv
import math
from collections import defaultdict
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from statistics import fmean
from typing import Any
from urllib.parse import unquote

from jinja2 import Environment, StrictUndefined
from markdown_it import MarkdownIt

from tex_lightning.core.files import read_record, read_rows, write_text
from tex_lightning.report.page_media import LEGEND, embedded, map_folder, shown_samples
from tex_lightning.report.style import colour_of
from tex_lightning.report.table import (
    TINY,
    facts,
    is_tiny,
    python_command,
    run_flags,
    run_overrides,
)

METRICS = {
    "train/loss": "training loss",
    "train/fragment_accuracy": "fragment accuracy in training",
    "val/loss": "validation loss",
    "val/vote_accuracy": "validation votes",
}


@dataclass(frozen=True)
class Curve:
    """One metric of one network.

    Attributes:
        network: Its name.
        metric: In words.
        values: One for each epoch, a mean over its steps; of several folds the first one's.
    """

    network: str
    metric: str
    values: list[float]


def read_curves(directory: Path) -> list[Curve]:
    """The curves of a run; of a cross-validation those of its first fold."""
    own = sorted(directory.glob("metrics/*/metrics.csv"))
    folds = sorted(directory.glob("folds/*/metrics/*/metrics.csv"))
    first = [path for path in folds if path.parts[-4] == folds[0].parts[-4]]
    found = [curve for path in [*own, *first] if path.is_file() for curve in _curves(path)]
    return [curve for curve in found if len(curve.values) > 1]


def _curves(path: Path) -> list[Curve]:
    values: dict[str, dict[int, list[float]]] = defaultdict(lambda: defaultdict(list))
    with path.open(newline="", encoding="utf-8") as stream:
        for line in csv.DictReader(stream):
            for key in METRICS:
                if line.get(key) and line.get("epoch"):
                    values[key][int(line["epoch"])].append(float(line[key]))
    return [
        Curve(path.parent.name, METRICS[key], [fmean(steps) for _, steps in sorted(epochs.items())])
        for key, epochs in values.items()
    ]


PAGE = "report.html"
REPORT = "report.md"
TABLES = ("frontier.csv", "senses.csv", "breaking_points.csv", "conditions.csv", "sweep.csv")
MOST_LINES = 200  # of a table that are shown; the file has all


def write_page(directory: Path, command: str | None = None) -> None:
    """Write ``report.html``: headline, curves, tables, figures, worst samples, settings, command.

    Everything is inside: pictures, and the recordings of the worst samples, small. Nothing is
    fetched, and what comes out of files is text, never markup.

    Args:
        directory: A run folder, or that of a sweep.
        command: What repeats it; None takes what the run folder says.
    """
    results = _read(directory / "results.json")
    settings = _read(directory / "settings.json")
    given = run_overrides(directory)
    report = directory / REPORT
    shown = _rendered(report, directory) if report.is_file() else ""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = environment.from_string(
        files("tex_lightning.report").joinpath("page.html").read_text(encoding="utf-8")
    )
    networks = facts(results)
    page = template.render(
        title=" · ".join(str(results[key]) for key in ("task", "model", "data") if results.get(key))
        or directory.name,
        tiny=TINY if is_tiny(given) else "",
        networks=networks,
        colours={name: colour_of(name) for name in networks},
        curves=[_drawn(curve) for curve in read_curves(directory)],
        report=shown,
        tables={name: _table(directory / name) for name in TABLES if (directory / name).is_file()},
        figures=_figures(directory, shown),
        samples=shown_samples(directory, list(networks)),
        legend=LEGEND if networks and map_folder(directory, [*networks][-1]).is_dir() else {},
        settings=settings,
        environment=results.get("environment", {}),
        seconds=results.get("wall_seconds"),
        command=command
        or python_command(*run_flags(directory), *given, f"hydra.run.dir={directory}"),
    )
    write_text(directory / PAGE, page)


def _read(path: Path) -> dict[str, Any]:
    return read_record(path) if path.is_file() else {}


def _rendered(report: Path, directory: Path) -> str:
    """``report.md`` as HTML, its title and command left out, its figures inside."""
    text = report.read_text(encoding="utf-8")
    _, _, rest = text.partition("```bash")
    body = rest.partition("```")[2] if rest else text
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = parser.parse(body)
    for token in tokens:
        for child in token.children or ():
            if child.type == "image":
                name = Path(unquote(str(child.attrs["src"]))).name
                source = directory / "figures" / name
                child.attrs["src"] = embedded(source) if source.is_file() else ""
    html: str = parser.renderer.render(tokens, parser.options, {})
    return html.replace("<table>", '<div class="wide"><table>').replace(
        "</table>", "</table></div>"
    )


def _figures(directory: Path, shown: str) -> list[dict[str, Any]]:
    """Return name and source of every figure that the report does not show."""
    paths = [*sorted(directory.glob("*.png")), *sorted(directory.glob("figures/*.png"))]
    sources = {path: embedded(path) for path in paths}
    return [
        {"name": path.stem.replace("_", " "), "source": source}
        for path, source in sources.items()
        if source not in shown
    ]


def _table(path: Path) -> dict[str, Any]:
    """Heading and lines of a CSV, figures with four digits."""
    lines = read_rows(path)
    heading = list(lines[0]) if lines else []
    return {
        "heading": heading,
        "lines": [[_short(line.get(name)) for name in heading] for line in lines[:MOST_LINES]],
        "left_out": max(0, len(lines) - MOST_LINES),
    }


def _short(value: str | None) -> str:
    try:
        number = float(value or "")
    except ValueError:
        return value or ""
    return value or "" if number == int(number) else f"{number:.4g}"


def _drawn(curve: Curve, width: int = 560, height: int = 150) -> dict[str, Any]:
    """A curve with the corners of its polyline in a box of so many units; NaN has none."""
    finite = [value for value in curve.values if math.isfinite(value)]
    low, high = min(finite, default=math.nan), max(finite, default=math.nan)
    across, span = max(1, len(curve.values) - 1), (high - low) or 1
    corners = [
        f"{index / across * width:.1f},{height - (value - low) / span * height:.1f}"
        for index, value in enumerate(curve.values)
        if math.isfinite(value)
    ]
    return {
        "curve": curve,
        "colour": colour_of(curve.network),
        "low": low,
        "high": high,
        "points": " ".join(corners),
    }
