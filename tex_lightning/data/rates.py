"""The sampling rate of a trace, its source, and the small CSV tables that state it.

The file itself decides first: the header of a WAV file, or a column of time. Then come the
statements beside it: the manifest or the reader, a sidecar ``FILE.json`` with the key ``rate``
(FILE is the trace's name with or without its suffix), and ``rates.csv`` with the columns
``path,rate`` in the trace's folder or one of the two above it. Last comes ``data.file_rate``, an
assumption. All statements about one file must agree.
"""

import csv
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, get_args

from tex_lightning.core.files import check_lines, is_file, read_json, resolved
from tex_lightning.data.time_column import RawTrace
from tex_lightning.data.trace_files import axis_paths, same_rate
from tex_lightning.errors import UserError, reason, shorten
from tex_lightning.text import from_cell

Record = dict[str, str]


def read_table(path: Path, what: str, needed: tuple[str, ...]) -> list[tuple[int, Record]]:
    """Read the records of a CSV file, with commas or semicolons, by the names in its first line.

    Args:
        path: An existing file.
        what: What to call it in messages.
        needed: Columns that it must have.

    Returns:
        Number of the line and record, for each.

    Raises:
        UserError: If it is no UTF-8 CSV, or a column is missing.
    """
    try:
        check_lines(path)
        with path.open(newline="", encoding="utf-8-sig") as stream:
            first = stream.readline()
            stream.seek(0)
            delimiter = ";" if ";" in first and "," not in first else ","
            reader = csv.DictReader(stream, delimiter=delimiter)
            names = [name.strip() for name in reader.fieldnames or ()]
            reader.fieldnames = names
            records = [
                (reader.line_num, {name: _text(cell) for name, cell in line.items()})
                for line in reader
            ]
    except (OSError, ValueError, csv.Error) as error:
        raise UserError(
            f"{what} {path} is not a UTF-8 CSV file ({reason(error)}); save it as CSV."
        ) from error
    missing = [column for column in needed if column not in names]
    if missing:
        raise UserError(
            f"{what} {path} lacks the column {', '.join(missing)}; "
            f"its first line must name {','.join(needed)}."
        )
    return records


def _text(cell: Any) -> Any:  # noqa: ANN401  (a short line has None, a long one a list)
    return from_cell(cell) if isinstance(cell, str) else cell


RATES_TABLE = "rates.csv"
LEVELS = 3  # ROOT/CLASS/haptic: a table may lie in each
OTHER_NAMES = {"samplerate", "samplingrate", "samplefrequency", "samplingfrequency", "fs", "hz"}
RateSource = Literal["header", "time column", "stated", "assumed"]
SOURCES: tuple[RateSource, ...] = get_args(RateSource)


@dataclass(frozen=True)
class SourceRate:
    """The rate of a trace before it is resampled.

    Attributes:
        hz: The rate.
        source: Who says so; ``stated`` is a manifest, a reader, a sidecar or ``rates.csv``.
        interpolated: Whether samples were interpolated, because their times are uneven.
    """

    hz: float
    source: RateSource
    interpolated: bool = False


def source_rate(path: Path, raw: RawTrace, given: float | None, assumed: float) -> SourceRate:
    """Decide on the rate of one trace.

    Args:
        path: Its file, for messages and to look beside it.
        raw: Its content.
        given: What the manifest or the reader says, in Hz.
        assumed: ``data.file_rate``.

    Raises:
        UserError: If a statement contradicts another one or the file, or cannot be understood.
    """
    stated = stated_rate(path, given)
    if raw.rate is None:
        if stated is not None:
            return SourceRate(stated, "stated")
        return SourceRate(assumed, "assumed")
    own: RateSource = "time column" if raw.timed else "header"
    if stated is not None and not same_rate(raw.rate, stated):
        raise UserError(
            f"Trace {path} has {raw.rate:,.6g} Hz by its {own}, but {stated:,.6g} Hz are stated "
            "for it (reader, manifest, sidecar or rates.csv); correct or remove one of them."
        )
    return SourceRate(raw.rate, own, raw.interpolated)


def stated_rate(path: Path, given: float | None = None) -> float | None:
    """The rate in Hz that other files state of a trace; None if none does.

    Args:
        path: The trace, or any of its axes if they lie apart.
        given: What the manifest or the reader says.

    Raises:
        UserError: If a sidecar or table cannot be understood, or they do not agree.
    """
    found = [("The manifest or reader", given)] if given is not None else []
    for file in axis_paths(path):
        found += [*_sidecars(file), *_table_entries(file)]
    for where, rate in found:
        if not same_rate(rate, found[0][1]):
            raise UserError(
                f"{found[0][0]} gives {path.name} {found[0][1]:,.6g} Hz, but {where} {rate:,.6g} "
                "Hz; correct or remove one of them."
            )
    return found[0][1] if found else None


def positive_number(value: object) -> float | None:
    """A rate in Hz out of JSON or a table, decimal comma allowed; None if it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value.replace(",", ".") if isinstance(value, str) else value)
    except (ValueError, OverflowError):
        return None
    return number if 0 < number < math.inf else None


def names_rate(name: str) -> bool:
    """Whether a key or column most probably means ``rate``."""
    return re.sub("[^a-z]", "", name.lower()) in OTHER_NAMES


def _sidecars(file: Path) -> Iterator[tuple[str, float]]:
    """Statements of the JSON files beside a trace; other keys are none of ours."""
    for path in (file.with_name(f"{file.name}.json"), file.with_suffix(".json")):
        if not is_file(path):
            continue
        content = read_json(path, "Sidecar")
        if not isinstance(content, dict):
            continue
        if "rate" in content:
            rate = None if isinstance(content["rate"], str) else positive_number(content["rate"])
            if rate is None:
                raise UserError(
                    f"Sidecar {path} has rate={shorten(repr(content['rate']))}, which is no "
                    "positive number; give Hz."
                )
            yield str(path), rate
        elif wrong := [key for key in content if names_rate(key)]:
            raise UserError(
                f"Sidecar {path} has the key {shorten(wrong[0])}; rename it to rate (Hz)."
            )


def _table_entries(file: Path) -> Iterator[tuple[str, float]]:
    folder = file.absolute().parent
    for _ in range(LEVELS):
        path = folder / RATES_TABLE
        if is_file(path):
            status = path.stat()
            rates = _read_rates(path, status.st_mtime_ns, status.st_size)
            if (rate := rates.get(resolved(file))) is not None:
                yield str(path), rate
        folder = folder.parent


@lru_cache(maxsize=16)
def _read_rates(path: Path, changed: int, size: int) -> dict[Path, float]:
    """Rates by file; read again when the table has ``changed``."""
    rates: dict[Path, float] = {}
    for number, record in read_table(path, "Table", ("path", "rate")):
        where = f"Table {path}, line {number}"
        target = resolved(path.parent / (record["path"] or "").strip())
        if not is_file(target):
            raise UserError(
                f"{where}: file {shorten(target)} does not exist; correct or remove the line."
            )
        rate = positive_number(record["rate"])
        if rate is None:
            raise UserError(
                f"{where}: rate is {shorten(repr(record['rate']))}, no positive number; give Hz."
            )
        if target in rates:
            raise UserError(f"{where}: {target.name} is listed twice; keep one line.")
        rates[target] = rate
    return rates
