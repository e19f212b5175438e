"""Traces in text files, as datasets and spreadsheets write them.

One sample a line, in columns that stand apart by comma, semicolon, tab or space. Understood are
decimal commas, comment lines that begin with ``#`` or ``%``, up to two lines of names and units,
byte order marks, UTF-16, trailing delimiters and a column of time (:mod:`.time_column`).
"""

import codecs
import re
from contextlib import suppress
from pathlib import Path

import numpy as np

from tex_lightning.data.time_column import RawTrace, separate_time

MARKS = ("#", "%")
PLAIN = b"0123456789+-.eE\r\n"  # of a file of one number a line
MAX_HEADER = 2  # names and units


def read_text_trace(path: Path, channel: int | None = None) -> RawTrace:
    """Read the columns of a text file and take its column of time out of them.

    Of the others one is kept if ``channel``, counted from 0, says which.

    Raises:
        ValueError: If it holds no numbers, or they cannot be told apart.
        UserError: If its column of time cannot be used.
    """
    content = path.read_bytes()
    if content.strip() and not content.translate(None, PLAIN):  # no dialect to find out
        with suppress(ValueError):
            return separate_time(path, np.loadtxt(path, ndmin=2), None, None, channel)
    comments, header, data = _divide(_decode(content))
    if not data:
        raise ValueError("no numbers")
    if len(header) > MAX_HEADER:
        raise ValueError(f"{len(header)} lines of words before the numbers: begin them with #")
    delimiter, decimal_comma = _dialect(data)
    lines = [line.replace(",", ".") for line in data] if decimal_comma else data
    columns = np.loadtxt(lines, delimiter=delimiter, ndmin=2)
    names, units = _names(header or comments[-MAX_HEADER:], delimiter, columns.shape[1])
    return separate_time(path, columns, names, units, channel)


def _decode(content: bytes) -> str:
    """Text of UTF-16 (Excel's "Unicode text"), UTF-8 or, for names alone, Latin-1."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _divide(text: str) -> tuple[list[str], list[str], list[str]]:
    """Comments before the numbers, header, and lines of numbers; no quotes, no trailing marks."""
    comments: list[str] = []
    header: list[str] = []
    data: list[str] = []
    for raw in text.replace('"', "").splitlines():
        line = raw.strip().rstrip(";,\t ")
        if line.startswith(MARKS):
            if not data:
                comments.append(line.lstrip("#% \t"))
        elif line and (data or _is_numbers(line)):
            data.append(line)
        elif line:
            header.append(line)
    return comments, header, data


def _is_numbers(line: str) -> bool:
    try:
        [float(field) for field in re.split(r"[;,\s]+", line) if field]
    except ValueError:
        return False
    return True


def _dialect(data: list[str]) -> tuple[str | None, bool]:
    """Delimiter (None is white space) and whether commas are decimal commas."""
    first = data[0]
    if ";" in first:
        delimiter = ";"
    elif "," in first and not re.search(r"\d[ \t]+[-+.\d]", first):
        return ",", False
    else:
        delimiter = None
    if not any("," in line for line in data):
        return delimiter, False
    if any("." in line for line in data):
        raise ValueError("it has both decimal points and commas inside its columns")
    return delimiter, True


def _names(
    lines: list[str], delimiter: str | None, count: int
) -> tuple[list[str] | None, list[str] | None]:
    """Names and units of ``count`` columns, as far as header or comments have that many."""
    rows = [cells for line in lines if (cells := _cells(line, delimiter, count)) is not None]
    if not rows:
        return None, None
    return rows[0], rows[1] if len(rows) > 1 else None


def _cells(line: str, delimiter: str | None, count: int) -> list[str] | None:
    """The cells of a line if there are ``count``; names may be divided otherwise than numbers."""
    marks: list[str | None] = [
        mark for mark in (delimiter, "\t", ";", ",") if mark and mark in line
    ]
    for mark in marks or [None]:
        cells = [cell.strip() for cell in line.split(mark)]
        if len(cells) == count:
            return cells
    return None
