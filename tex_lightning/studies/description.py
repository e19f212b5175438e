"""Describe the data of a run: for the console, the report and the loggers."""

import json
import logging
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

from rich.text import Text

from tex_lightning.config import DataConfig, Folding
from tex_lightning.core.console import QUIET, Screen, console
from tex_lightning.core.files import write_bytes, write_text
from tex_lightning.data.decode import ASSUMED, SignalDecoder
from tex_lightning.data.folds import split, tested_part
from tex_lightning.data.inspection import copies
from tex_lightning.data.recordings import Recordings, plural
from tex_lightning.data.store import Store, skipped_entry
from tex_lightning.report.artifacts import png
from tex_lightning.report.data_page import FILE, FOLDER, PARTS, Description, data_facts
from tex_lightning.report.pictures import recording_picture, row_of
from tex_lightning.studies.dataset import Dataset
from tex_lightning.studies.notes import MAX_NOTES, recording_notes
from tex_lightning.text import printable_lines
from tex_lightning_runtime.columns import Reading

LONG = ("Data", "Classes")  # lines of the opening that are cut at its width
MAX_KINDS = 5  # ways of reading that the opening lists
MAX_EXAMPLES = 24  # classes of which an example is drawn
SIDE, WIDTH = 112, 176  # pixels of an example, and of a signal's to the right
ACROSS = 6  # examples in a row
log = logging.getLogger(__name__)


def describe_data(
    data: DataConfig, dataset: Dataset, divisions: Sequence[Folding] = ()
) -> Description:
    """Describe what is trained and tested on, in plain values for JSON.

    There is a division of each training; a test alone has none.

    Returns:
        ``name``, ``from``, ``classes``; ``recordings`` by modality, see :func:`_describe_modality`;
        ``folds``, a phrase; the number of ``trainings``; ``skipped`` and ``notes``, what was left
        out and what looks wrong.
    """
    rows = dataset.recordings
    modalities = list(dict.fromkeys(row.modality for row in rows))
    notes = [*rows.notes, *dataset.absences(divisions)]
    same = [
        f"{finding.text}: {finding.files}; keep one, or give them one group."
        for finding in copies(rows)
    ]
    more = [f"{len(same) - MAX_NOTES} more contents are in several files (task=inspect)."]
    notes += [*same[:MAX_NOTES], *(more if len(same) > MAX_NOTES else [])]
    return {
        "name": data.name,
        "from": str(data.manifest or data.root or ""),
        "classes": rows.classes,
        "recordings": {
            modality: _describe_modality(rows.of(modality), dataset.store, divisions)
            for modality in modalities
        },
        "folds": _folds(divisions) if divisions else "",
        "trainings": len(divisions),
        "skipped": skipped_entry(dataset.skipped),
        "notes": [*notes, *recording_notes(dataset)],
    }


def _describe_modality(
    rows: Recordings, store: Store, divisions: Sequence[Folding]
) -> dict[str, Any]:
    """Describe the recordings of one modality.

    Returns:
        Their number (``files``), sizes in ``unit`` (seconds or megapixels: ``shortest``,
        ``median``, ``longest``, ``total``), ``groups``, ``of_class``, the number of each class;
        ``parts``, least and most recordings of each part of the divisions; of signals ``axes`` and
        ``rates`` in Hz, each least and most, ``assumed``, how many rates nobody has given, and
        ``read``, how files were read.
    """
    decoder = store.decoders[rows.rows[0].modality]
    sizes = [store.extent(row) for row in rows]
    entry: dict[str, Any] = {
        "called": plural(rows.rows[0].modality),
        "files": len(rows),
        "unit": decoder.unit,
        "shortest": min(sizes), "median": median(sizes), "longest": max(sizes), "total": sum(sizes),
        "groups": len({row.group_key for row in rows}),
        "of_class": dict(Counter(row.label for row in rows)),
        "parts": _count_parts(rows, divisions),
    }  # fmt: skip
    if not isinstance(decoder, SignalDecoder):
        return entry
    axes, rates = [store.shape(row)[0] for row in rows], [store.rate(row) for row in rows]
    assumed = sum(store.reading(row).rate_from.startswith(ASSUMED) for row in rows)
    return entry | {
        "axes": [min(axes), max(axes)],
        "rates": [min(rates), max(rates)],
        "assumed": assumed,
        "read": readings(rows, store),
    }


def _count_parts(rows: Recordings, divisions: Sequence[Folding]) -> dict[str, list[int]]:
    """Return least and most recordings of each part, over all divisions that test something."""
    counted = [by for by in divisions if by.withholds] or divisions
    parts = [split(rows, by, trains=True) for by in counted]
    counts = {name: [len(getattr(part, name)) for part in parts] for name in PARTS}
    return {name: [min(found), max(found)] for name, found in counts.items() if any(found)}


def show_opening(
    data: DataConfig,
    dataset: Dataset,
    what: str,
    *,
    trains: Iterable[Folding] = (),
    keep_in: Path | None = None,
) -> Description:
    """Log the notes on the data, and print and return their description.

    Args:
        data: Where the recordings come from.
        dataset: All that will be trained or tested on.
        what: Description of the training or test; empty of neither.
        trains: Division of each training; without any there is only a test.
        keep_in: Run folder that gets the description and an example of each class, for its report.
    """
    divisions = list(trains)
    verb = "Trains" if divisions else "Tests"
    description = describe_data(data, dataset, divisions)
    for text in description["notes"]:
        log.warning("%s", text)
    if keep_in is not None:
        keep_description(description, dataset, keep_in)
    if Screen.verbose != QUIET:
        for heading, text in [*data_facts(description), *([(verb, what)] if what else [])]:
            line, cut = Text(f"{heading:<8} {printable_lines(text)}"), heading in LONG
            console.print(line, no_wrap=cut, overflow="ellipsis" if cut else None)
    return description


def keep_description(description: Description, dataset: Dataset, directory: Path) -> None:
    """Write the description, and an example of each class, for the report."""
    write_text(directory / FILE, json.dumps(description, indent=1))
    for modality in description["recordings"]:
        rows = dataset.recordings.of(modality)
        first = {row.label: row for row in reversed(rows.rows)}
        labels = rows.classes[:MAX_EXAMPLES]
        rate = getattr(dataset.store.decoders[modality], "sampling_rate", None)
        size = (SIDE if rate is None else WIDTH), SIDE
        pictures = [
            recording_picture(dataset.store.load(first[label]), rate, size) for label in labels
        ]
        sheet = row_of(pictures, labels, ACROSS)
        write_bytes(directory / FOLDER / f"{modality}.png", png(sheet))


def _folds(divisions: Sequence[Folding]) -> str:
    """Say how recordings are divided for one training, or for several in turn."""
    by, count = divisions[0], divisions[0].folds
    tests = [division for division in divisions if division.withholds]
    if not tests:
        but = "" if by.val_fold is None else f" but fold {by.val_fold}, which chooses the epoch"
        return f"{count}; all are trained on{but}, and nothing is tested"
    if len(tests) < len(divisions):
        return f"{_folds(tests)}; then all are trained on"
    if len(tests) > 1:
        return f"{count}, of which {len(tests)} are tested, one after the other"
    if by.inverted and by.test_fold is not None:
        return f"{count}, of which fold {by.test_fold} is trained on and the others are tested"
    chosen = "" if by.val_fold is None else f", and fold {by.val_fold} chooses the epoch"
    return f"{count}, of which {tested_part(by)} is tested{chosen}"


def readings(signals: Recordings, store: Store) -> list[str]:
    """Say how files of signals were read: once for all that agree, those of most files first."""
    rates: dict[Reading, list[float]] = defaultdict(list)
    first: dict[Reading, str] = {}
    for row in signals:
        kind = replace(store.reading(row), notes=())
        rates[kind].append(store.rate(row))
        first.setdefault(kind, row.path.name)
    lines = []
    for kind, values in sorted(rates.items(), key=lambda item: -len(item[1]))[:MAX_KINDS]:
        some = "" if len(rates) == 1 else f"{len(values)} as {first[kind]}: "
        lines.append(some + kind.said(*sorted({min(values), max(values)})))
    more = len(rates) - MAX_KINDS
    return [*lines, f"and in {more} more ways"] if more > 0 else lines
