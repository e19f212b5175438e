"""Readers: each maps a data set on disk to the one table of recordings."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from tex_lightning.config import DataConfig
from tex_lightning.config.instantiation import build_typed
from tex_lightning.data.conditions import check_conditions
from tex_lightning.data.decode import IMAGE_SUFFIXES
from tex_lightning.data.folds import with_folds
from tex_lightning.data.rates import stated_rate
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.table_check import checked_table
from tex_lightning.errors import UserError


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
