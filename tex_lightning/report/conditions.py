"""Accuracy by condition: ``conditions.csv``, and the rows of the tables that show it."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from tex_lightning.core.files import write_rows
from tex_lightning.evaluation.conditions import KEY, pool_conditions

FILE = "conditions.csv"
COLUMNS = (
    "condition", "value", "network", "correct", "test_samples", "vote_accuracy", "ci_low",
    "ci_high",
)  # fmt: skip
MANY = 12  # values of a condition that a table does not list

Networks = Mapping[str, Mapping[str, Any]]  # entries of results.json, by name
Counts = Mapping[str, Any]


def write_conditions(networks: Networks, directory: Path) -> None:
    """Write ``conditions.csv`` with the columns ``COLUMNS``; nothing without conditions."""
    lines = [
        [name, value, network, counts["correct"], counts["test_samples"], counts["vote_accuracy"],
         *counts["vote_ci95"]]
        for name, value, of in _rows(networks)
        for network, counts in of.items()
    ]  # fmt: skip
    if lines:
        write_rows(directory / FILE, COLUMNS, lines)


def condition_rows(networks: Networks, say: Callable[[Counts], str]) -> list[list[str]]:
    """Rows of a table: condition, value and what ``say`` makes of the votes of each network.

    A condition of many values, such as a date, has one row that names the file with all of them;
    one of a single value has none, as its votes are those of all samples.
    """
    rows: dict[str, list[list[str]]] = {}
    for name, value, of in _rows(networks):
        cells = [say(of[network]) if network in of else "" for network in networks]
        rows.setdefault(name, []).append([name, value, *cells])
    return [
        line
        for name, lines in rows.items()
        if len(lines) > 1
        for line in (
            lines
            if len(lines) <= MANY
            else [[name, f"{len(lines)} values, see {FILE}", *[""] * len(networks)]]
        )
    ]


def _rows(networks: Networks) -> Iterator[tuple[str, str, dict[str, Counts]]]:
    """Conditions and their values, and for each what the networks made of it."""
    every = pool_conditions(networks.values()).get(KEY, {})
    for name, values in every.items():
        for value in values:
            yield (
                name,
                value,
                {
                    network: entry[KEY][name][value]
                    for network, entry in networks.items()
                    if value in entry.get(KEY, {}).get(name, {})
                },
            )
