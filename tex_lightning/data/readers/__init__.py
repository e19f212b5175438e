"""Readers make the table of recordings of a data set; what they return is checked here."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from tex_lightning.config import DataConfig
from tex_lightning.config.instantiation import build
from tex_lightning.core.contract import breach, calling, check_call
from tex_lightning.data.folds import as_override, check_conditions, with_folds
from tex_lightning.data.readers.layout import hint
from tex_lightning.data.recordings import (
    Recording,
    Recordings,
    check_distinct,
    check_row,
    with_one_spelling,
    with_plain_numbers,
)
from tex_lightning.errors import UserError, listed, shorten

MORE_CLASSES = (
    "add recordings of another, give the classes in a manifest, or write what one file holds of "
    "several into files of their own (docs/data.md, Manifest)."
)


def checked_table(table: Any, reader: str) -> Recordings:  # noqa: ANN401
    """Return the table that the ``read()`` of a class named ``reader`` has returned.

    Raises:
        UserError: If it is no table, is empty, lists something twice, or a row is not as
            :class:`~tex_lightning.Recording` says.
    """
    if not isinstance(table, Recordings):
        raise UserError(
            f"{reader}.read() of data.reader returned {type(table).__name__}; let it return "
            "tex_lightning.Recordings."
        )
    rows = tuple(table.rows)
    for number, row in enumerate(rows, start=1):
        check_row(row, f"Record {number} of the table of {reader} (data.reader)")
    rows = tuple(map(with_plain_numbers, rows))
    if not rows:
        raise UserError(f"{reader} (data.reader) found no recordings; check the keys of data.")
    check_distinct(f"{reader} (data.reader)", rows)
    without = [row for row in rows if row.fold is None]
    if 0 < len(without) < len(rows):
        raise UserError(
            f"{reader} (data.reader) gives {without[0].path} no fold; give every recording one, or "
            "none."
        )
    named = with_one_spelling(Recordings(rows, table.notes))
    return replace(named, notes=(*named.notes, *divided_groups(named.rows)))


def read_table(reader: Any) -> Recordings:  # noqa: ANN401
    """Return the checked table of a reader.

    Raises:
        UserError: If :func:`checked_table` rejects it.
        Exception: Any exception of a custom reader, with a note of its contract.
    """
    part, name = ("data.reader", "reader", reader), type(reader).__name__
    read: Any = getattr(reader, "read", None)
    if not callable(read):
        raise breach(*part, "has no method read")
    check_call(part, read)
    with calling(*part):
        table = read()
    return checked_table(table, name)


def divided_groups(rows: Sequence[Recording]) -> list[str]:
    """Say that the folds of a table divide groups, where they do."""
    folds: dict[str, set[int]] = defaultdict(set)
    for row in rows:
        if row.fold is not None:
            folds[row.group_key].add(row.fold)
    divided = {group: sorted(found) for group, found in folds.items() if len(found) > 1}
    if not divided:
        return []
    group, places = next(iter(divided.items()))
    return [
        f"The folds of the table divide {len(divided)} groups, {shorten(group)} into folds "
        f"{listed([*map(str, places)])}: what was recorded together is trained and tested on; give "
        "such recordings one fold, or leave out the folds."
    ]


def read_recordings(
    config: DataConfig, modalities: Sequence[str] | None = None, *, least: int = 2
) -> Recordings:
    """Read the configured data set with its folds, cut to its first ``data.classes`` classes.

    Args:
        config: Names the reader.
        modalities: Modalities that a checkpoint needs, for a reader that makes no others; None are
            those of the configured model.
        least: Smallest number of classes; classification takes two.

    Raises:
        UserError: If the data set is missing, incomplete or has fewer classes than asked for, or
            cannot be divided by ``data.test_where``.
    """
    node = config.reader
    if modalities is not None and "senses" in node:
        node = {**node, "senses": list(modalities)}
    reader = build("data.reader", node)
    recordings = read_table(reader)
    classes = recordings.classes
    if config.classes is not None and config.classes > len(classes):
        raise UserError(
            f"data.classes asks for {config.classes} classes, but the data has "
            f"{len(classes)}; lower it or leave it out."
        )
    if len(classes) < least:
        raise UserError(
            f"The data has only the class {', '.join(classes)}; telling classes apart takes two; "
            + " ".join([MORE_CLASSES, *recordings.notes, *hint(config.root, recordings)])
        )
    recordings = recordings.in_classes(classes[: config.classes])
    told = _own_division(recordings) if config.test_where is None else []
    recordings = with_folds(replace(recordings, notes=(*recordings.notes, *told)), config.folds)
    if config.test_where is not None:
        senses = {row.modality for row in recordings} if modalities is None else modalities
        rows = tuple(row for row in recordings if row.modality in senses)
        check_conditions(Recordings(rows), config.test_where)
    return recordings


def _own_division(recordings: Recordings) -> list[str]:
    """Say of conditions that name what is tested, such as a column ``split``, how they divide."""
    free = (row for row in recordings if row.fold is None)
    found = defaultdict[str, set[str]](set)
    for name, value in (pair for row in free for pair in row.conditions):
        found[name].add(value)
    return [
        f"The folds do not follow the condition {name}; to test what is {value} by task=fit, give "
        f"{as_override({name: value})}."
        for name, values in found.items()
        for value in sorted(values)
        if len(values) > 1 and value.casefold() in ("test", "testing")
    ]
