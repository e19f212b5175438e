"""Pieces of a run for its loggers: figures of the run folder, and texts."""

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tex_lightning.report.board import Picture, Words
from tex_lightning.report.table import facts, markdown, typed_overrides
from tex_lightning.text import printable, to_markdown

# Tags of the figures that a test draws, by the end of their file's name.
FIGURES = {
    "confusion": "confusion/recordings",
    "confusion_fragments": "confusion/fragments",
    "classes": "histogram/fragment accuracy by class",
    "pairs": "pairs/most confused",
    "calibration": "reliability/recordings",
}


def figure_pieces(directory: Path, network: str) -> Iterator[Picture]:
    """Yield the figures of a network in the run folder, as they were saved.

    Args:
        directory: The run folder.
        network: Name of the network.
    """
    for file in sorted((directory / "figures").glob(f"{network}_*.png")):
        name = file.stem.removeprefix(f"{network}_")
        yield Picture(FIGURES.get(name, f"figures/{name}"), file.read_bytes())


def text_pieces(
    directory: Path, results: Mapping[str, Any], data: Mapping[str, str]
) -> Iterator[Words]:
    """Yield the command of a run, what its data are and its results.

    Args:
        directory: The run folder.
        results: Content of ``results.json`` as far as it is known: classes and networks.
        data: Facts of the data by heading.
    """
    command = shlex.join(["python", "-m", "tex_lightning", *typed_overrides(directory)])
    yield Words("1 command", f"    {printable(command)}")
    yield Words("2 data", _table([["data", ""], *map(list, data.items())]))
    shown = facts(results)
    rows = {fact: None for network in shown.values() for fact in network}
    cells = [[fact, *(network.get(fact, "") for network in shown.values())] for fact in rows]
    yield Words("3 results", _table([["", *shown], *cells]))


def _table(rows: list[list[str]]) -> str:
    first, *others = [[to_markdown(cell) for cell in row] for row in rows]
    return "\n".join(markdown(first, others))
