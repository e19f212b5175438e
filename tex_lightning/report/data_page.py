"""The part of a report that describes the data: tables and example pictures."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tex_lightning.core.console import console
from tex_lightning.core.files import read_or_empty
from tex_lightning.report.table import Table, make_table

FILE = "data.json"
FOLDER = "data"  # of the pictures
PARTS = {"train": "trained on", "val": "validate", "test": "tested"}
MAX_LISTED = 50  # files that a table lists
Description = dict[str, Any]


def data_tables(directory: Path) -> list[Table]:
    """Return the tables of the data of a run: sizes, classes, skipped files and notes."""
    told = read_or_empty(directory / FILE)
    if not told:
        return []
    tables = [
        Table("The data", [{"": heading, "data": text} for heading, text in data_facts(told)]),
        Table("Suspected", _suspected(told.get("findings", ()))),
        Table("Recordings by class", _by_class(told)),
        Table("Left out", [dict(entry) for entry in told["skipped"]][:MAX_LISTED]),
        Table("Notes on the data", [{"note": note} for note in told["notes"]][:MAX_LISTED]),
    ]
    return [table for table in tables if table.rows]


def data_facts(told: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return what a description says for people, each time a heading and a text.

    A heading may come again: files of one modality can be read in several ways.
    """
    facts = [
        ("Data", f"{told['name']} {told['from']}".rstrip()),
        ("Classes", f"{len(told['classes'])}: {', '.join(told['classes'])}"),
    ]
    for entry in told["recordings"].values():
        called = str(entry["called"])
        facts.append((called[:1].upper() + called[1:], _sizes(entry)))
        facts += [("Reads", text) for text in entry.get("read", ())]
    if told["folds"]:
        facts += [("Folds", told["folds"]), ("Parts", _parts(told))]
    if told["skipped"]:
        facts.append(("Left out", f"{len(told['skipped'])} files that cannot be used"))
    return facts


def _sizes(entry: Mapping[str, Any]) -> str:
    """Say how many recordings there are: size, how many of a class, groups, axes and rates."""
    unit, few = entry["unit"], entry["of_class"].values()
    files, groups = entry["files"], entry["groups"]
    said = [
        f"{files} file{'s' * (files != 1)}",
        f"{_range(entry['shortest'], entry['longest'])} {unit} each, {entry['total']:,.4g} in all",
        f"{_range(min(few), max(few))} of a class",
        f"{groups} group{'s' * (groups != 1)}",
    ]
    if "axes" in entry:
        assumed = f" ({entry['assumed']} only assumed)" if entry["assumed"] else ""
        said.append(f"{_range(*entry['axes'])} {'axis' if entry['axes'][1] == 1 else 'axes'}")
        said.append(f"{_range(*entry['rates'])} Hz{assumed}")
    return "; ".join(said)


def _parts(told: Mapping[str, Any]) -> str:
    """Say how many recordings of each modality are trained on, chosen and tested on."""
    said = []
    for entry in told["recordings"].values():
        counts = [f"{_range(*count)} {PARTS[name]}" for name, count in entry["parts"].items()]
        said.append(f"{entry['called']}: {', '.join(counts)}")
    return ("each time " if told.get("trainings", 1) > 1 else "") + "; ".join(said)


def _range(low: float, high: float) -> str:
    one, other = (f"{float(f'{value:.4g}'):,.10g}" for value in (low, high))
    return one if one == other else f"{one} to {other}"


def _by_class(told: Mapping[str, Any]) -> list[dict[str, str]]:
    entries = told["recordings"].values()
    return [
        {
            "class": label,
            **{entry["called"]: str(entry["of_class"].get(label, 0)) for entry in entries},
        }
        for label in told["classes"]
    ]


def _suspected(findings: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
    return [
        {"kind": found["kind"], "what": found["text"], "files": found["files"]}
        for found in findings[:MAX_LISTED]
    ]


def print_findings(findings: Sequence[Mapping[str, str]]) -> None:
    """Print what is suspected of the data, or that nothing is."""
    if not findings:
        console.print("Nothing is suspected: no copy, no shared stretch, nothing clipped.")
        return
    cells = (found.values() for found in _suspected(findings))
    console.print(make_table("suspected", ["kind", "what", "files"], [], cells))
    if (more := len(findings) - MAX_LISTED) > 0:
        console.print(f"And {more} more in results.json.")
