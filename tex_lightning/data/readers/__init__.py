"""Readers: each maps a data set on disk to the one table of recordings, which is checked here."""

import math
from collections.abc import Sequence
from dataclasses import replace
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Protocol

from tex_lightning.config import DataConfig
from tex_lightning.config.instantiation import build_typed
from tex_lightning.data.decode import IMAGE_SUFFIXES
from tex_lightning.data.folds import check_conditions, with_folds
from tex_lightning.data.rates import stated_rate
from tex_lightning.data.recordings import Recording, Recordings, check_distinct
from tex_lightning.errors import UserError, shorten


def checked_table(made: Any, reader: str) -> Recordings:  # noqa: ANN401
    """The table that the ``read()`` of a class named ``reader`` has returned.

    Raises:
        UserError: If it is no table, is empty, lists something twice, or a row is not as
            :class:`Recording` says.
    """
    if not isinstance(made, Recordings):
        raise UserError(
            f"{reader}.read() of data.reader returned {_kind(made)}; let it return "
            "tex_lightning.Recordings."
        )
    rows = tuple(made.rows)
    for number, row in enumerate(rows, start=1):
        if wrong := _wrong(row):
            raise UserError(f"Record {number} of the table of {reader} (data.reader) has {wrong}.")
    if not rows:
        raise UserError(f"{reader} (data.reader) found no recordings; check the keys of data.")
    check_distinct(f"{reader} (data.reader)", rows)
    return Recordings(rows, made.notes)


def _wrong(row: Any) -> str:  # noqa: ANN401
    """What a row has and what it should; empty if nothing is wrong."""
    if not isinstance(row, Recording):
        return f"{_kind(row)}; make a tex_lightning.Recording"
    checks = {
        "label": (isinstance(row.label, str) and row.label != "", "a name"),
        "modality": (
            isinstance(row.modality, str) and row.modality.isidentifier(),
            "one word, such as haptic or image",
        ),
        "path": (isinstance(row.path, Path), "a pathlib.Path"),
        "group": (
            (isinstance(row.group, str) and row.group.strip() != "")
            or (_is_number(row.group, Integral) and int(row.group) >= 0),
            "a text, such as a session, or a whole number from 0",
        ),
        "sampling_rate": (
            row.sampling_rate is None
            or (_is_number(row.sampling_rate, Real) and 0 < row.sampling_rate < math.inf),
            "a number of Hz, or None",
        ),
        "conditions": (_are_pairs(row.conditions), "a tuple of names and values, all texts"),
    }
    wanted = ((name, text) for name, (right, text) in checks.items() if not right)
    return next(
        (f"{name} {shorten(repr(getattr(row, name)))}; give {text}" for name, text in wanted), ""
    )


def _is_number(value: object, kind: type) -> bool:
    return isinstance(value, kind) and not isinstance(value, bool)


def _are_pairs(conditions: object) -> bool:
    return isinstance(conditions, tuple) and all(
        isinstance(each, tuple) and len(each) == 2 and all(isinstance(text, str) for text in each)
        for each in conditions
    )


def _kind(value: object) -> str:
    return f"the class {value.__name__}" if isinstance(value, type) else type(value).__name__


class Reader(Protocol):
    """A data set: its fields are its keys, ``data.reader.FIELD``."""

    def read(self) -> Recordings:
        """The table of its recordings."""


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
    reader: Reader = build_typed("data.reader", node)
    recordings = checked_table(reader.read(), type(reader).__name__)
    classes = recordings.classes
    if config.classes is not None and config.classes > len(classes):
        raise UserError(
            f"data.classes asks for {config.classes} classes, but the data has "
            f"{len(classes)}; lower it or leave it out."
        )
    if len(classes) < least:
        raise UserError(
            f"The data has only the class {', '.join(classes)}; telling classes apart takes two; "
            "add recordings of another."
        )
    recordings = with_folds(recordings.in_classes(classes[: config.classes]), config.folds)
    if config.test_where is not None:
        senses = {row.modality for row in recordings} if modalities is None else modalities
        rows = tuple(row for row in recordings if row.modality in senses)
        check_conditions(Recordings(rows), config.test_where)
    return _with_stated_rates(recordings)


def _with_stated_rates(recordings: Recordings) -> Recordings:
    """Give signals the rates that sidecars and tables beside them state."""
    rows = tuple(
        row
        if row.path.suffix.lower() in IMAGE_SUFFIXES
        else replace(row, sampling_rate=stated_rate(row.path, row.sampling_rate))
        for row in recordings
    )
    return replace(recordings, rows=rows)
