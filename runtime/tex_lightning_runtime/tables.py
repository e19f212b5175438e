"""Signals in files of text as people and programs write them, to samples (axes, samples).

Separator and quotes are found by clevercsv, an unusual encoding by chardet; numbers and times are
read by pandas. :mod:`.column` says what a column means. The libraries are loaded with
the first table.
"""

import re
import warnings
from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module
from io import BytesIO
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from tex_lightning_runtime.cells import MISSING, NUMBER, QUANTITY, VECTOR, decimal_mark, kind
from tex_lightning_runtime.column import Column
from tex_lightning_runtime.columns import Reading, separate
from tex_lightning_runtime.heading import mismatch
from tex_lightning_runtime.layout import Layout, find_layout
from tex_lightning_runtime.plain_text import read_plain, with_long_lines_as_columns
from tex_lightning_runtime.samples import Array, Channels
from tex_lightning_runtime.times import STAMP, TableError

if TYPE_CHECKING:
    import pandas as pd

MIN_LINES = 4  # with a whole number and fractions, which may begin at 0 in three axes
HEADER = "the header of the file"  # where a rate stands
SUFFIXES = (".txt", ".csv", ".tsv", ".lvm")
FIELDS = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")
FORTRAN = r"(?<=[\d.])[dD](?=[-+]\d)"  # 1.5D+03
BLANKS = r"[\s'’\u00a0\u202f]"  # in numbers of many digits


def read_table(path: Path, channels: Channels = None, time_unit: str | None = None) -> "Table":
    """Read the axes out of a table of samples, one a line.

    Args:
        path: A file of text.
        channels: Which axes are kept: numbers from 0, or names of columns; None keeps all.
        time_unit: Unit of times that are numbers, such as ``ms``; None takes the table's.

    Returns:
        Samples (axes, samples) float64, their rate in Hz (None if the file does not state it), and
        how they were read.

    Raises:
        TableError: If the file is no table, or what it means is in doubt.
        ModuleNotFoundError: If the libraries are not there.
    """
    pandas = _library()
    content, long_lines = with_long_lines_as_columns(read_plain(path))
    content, layout = find_layout(content)
    frame, notes = _parse(pandas, content, layout), layout.notes
    if layout.names and {*frame.iloc[0].dropna()} == {len(frame) - 1}:  # the number of samples
        frame = frame[1:].reset_index(drop=True)
    rows, count = frame.shape
    if layout.names is None and 0 <= (layout.count or 0) - frame.size < count > 1:
        raise TableError(f"has {layout.count} samples in lines of {count}; write one sample a line")
    if layout.names is None and rows < count:
        _check_labels(frame)
        if _are_titles(frame[0]):
            layout, frame = replace(layout, names=(*frame[0].astype(str),)), frame.drop(columns=0)
        frame = frame.T.reset_index(drop=True).infer_objects()
        long_lines = rows
    if long_lines:
        read = f"each of its {long_lines} lines is read as an axis of {len(frame)} samples"
        notes = (*notes, read)
    samples, rate, reading = separate(_columns(frame, layout), channels, time_unit, layout.rate)
    if layout.again and not reading.rate_from.startswith("times in"):
        raise TableError(
            f"has {layout.again.strip()[:40]!r} above the numbers and again between them; divide "
            "it there, since a recording begins anew"
        )
    return samples, rate, replace(reading, notes=(*notes, *reading.notes))


def separate_arrays(
    arrays: Mapping[str, Array], channels: Channels, time_unit: str | None, rate: float | None
) -> "Table":
    """Read the axes out of arrays (axes, samples) of one length, by their names, as out of columns.

    ``rate`` is theirs in Hz if it is known; results and errors are those of :func:`read_table`.
    """
    pandas = _library()
    columns: list[Column] = []
    for name, rows in arrays.items():
        for number, values in enumerate(rows, 1):
            title = name if len(rows) == 1 else f"{name}_{number}"
            columns.append(Column(title, "", pandas.Series(values), first=not columns, array=name))
    return separate(columns, channels, time_unit, rate, rate_from=HEADER)


def _check_labels(frame: "pd.DataFrame") -> None:
    """Reject lines of fractions of which each begins or ends with a whole number, a label."""
    whole = [place for place, cells in enumerate(frame.dtypes) if cells.kind in "iu"]
    at_ends = whole in ([0], [len(frame.columns) - 1])
    if len(frame) >= MIN_LINES and at_ends and frame[whole[0]].any():  # axes may rest there
        raise TableError(
            f"has {len(frame)} recordings of a line by the label in each; write each into a file "
            "of its own, without its label, one sample a line"
        )


def _are_titles(cells: "pd.Series[Any]") -> bool:
    """Return whether cells are names, all different."""
    return cells.dtype.kind not in "iuf" and cells.nunique() == len(cells) and all(
        kind(cell) == "text" for cell in cells.astype(str)
    )  # fmt: skip


Table = tuple[Array, float | None, Reading]


def _library() -> ModuleType:
    try:
        import_module("clevercsv")
        return import_module("pandas")
    except ModuleNotFoundError as error:
        raise TableError(
            f"is a table, which takes {error.name}: pip install 'tex_lightning_runtime[tables]', "
            "or give WAV or .npy"
        ) from error


def _parse(pandas: ModuleType, content: bytes, layout: Layout) -> "pd.DataFrame":
    separator = layout.dialect.separator
    try:
        with warnings.catch_warnings(action="ignore"):  # of cells of text between numbers
            frame = pandas.read_csv(
                BytesIO(content), header=None, sep=r"\s+" if separator == " " else separator,
                quotechar=layout.dialect.quote, decimal=layout.decimal, thousands=layout.thousands,
                na_values=[*MISSING], dtype=layout.words, skipinitialspace=True,
            )  # fmt: skip
    except pandas.errors.ParserError as error:
        if found := FIELDS.search(str(error)):
            number = int(found[2]) + layout.first_line - 1
            raise TableError(
                f"has {found[3]} columns in line {number} and {found[1]} before; correct that "
                "line, or divide the file there if a recording begins anew"
            ) from error
        raise
    except pandas.errors.EmptyDataError as error:
        raise TableError("holds no numbers; give one sample a line") from error
    if frame.iloc[-1].isna().all():
        frame = frame[: frame.notna().any(axis=1).to_numpy().nonzero()[0].max(initial=-1) + 1]
    return frame


def _columns(frame: "pd.DataFrame", layout: Layout) -> list[Column]:
    """Return the columns that hold anything, with their names.

    Raises:
        TableError: If there are not as many names as columns.
    """
    empty = [not frame[n].notna().iloc[0] and not frame[n].notna().any() for n in frame]
    names, count = layout.names, len(frame.columns)
    while count and empty[count - 1] and (names is None or not "".join(names[count - 1 :])):
        count -= 1  # separators at the ends of lines
    if names is not None:
        while len(names) > count and names[-1].casefold() in ("", "comment"):
            names = names[:-1]
        if len(names) != count:
            raise mismatch(len(names), count)
    if names is None and _begins_with_date(frame):
        raise TableError(
            "begins with year, month and day in columns without names; write a line of names above "
            "them, such as year,month,day,hour,min,sec,x,y,z"
        )
    columns = []
    for number in (n for n in range(count) if not empty[n]):
        name = str(number + 1) if names is None else names[number]
        setting = number > 0 and _are_titled(frame[number], frame[number - 1])
        for title, cells in _divided(name, frame[number]).items():
            values, unit, fault = (cells.astype(object), "", "") if setting else _numbers(cells)
            unit = layout.units[number] if number < len(layout.units) else unit
            columns.append(Column(title, unit, values, names is not None, number == 0, fault))
    return columns


def _divided(name: str, cells: "pd.Series[Any]") -> dict[str, "pd.Series[Any]"]:
    """Return a column for each number in cells such as (0.1, 0.2, 9.8); others as they are."""
    if not VECTOR.fullmatch(str(cells.iloc[0])):
        return {name: cells}
    text = cells.astype(str)
    if not text.str.fullmatch(VECTOR).all():
        return {name: cells}
    parts = text.str.strip("()[] ").str.split(r"[,;\s]+", expand=True, regex=True)
    return {f"{name}_{number + 1}": parts[number] for number in parts}


def _are_titled(cells: "pd.Series[Any]", titles: "pd.Series[Any]") -> bool:
    """Return whether some numbers have a title left of them each, and there are no others."""
    known = cells.notna()
    some = cells.dtype.kind in "iuf" and titles.dtype.kind not in "iuf" and not known.all()
    return bool(some and known.equals(titles.notna()))


def _begins_with_date(frame: "pd.DataFrame") -> bool:
    """Return whether the first of more than five columns are year, month and day, or reversed."""
    day = frame.iloc[:, :3]
    if len(frame.columns) < 6 or any(each.kind not in "iuf" for each in day.dtypes):
        return False
    low, middle, year = sorted(day.iloc[0])
    fits = low >= 1 and middle <= 31 and 1970 <= year < 2100
    return bool(fits and (day == day.iloc[0]).all(axis=None))


def _numbers(cells: "pd.Series[Any]") -> tuple["pd.Series[Any]", str, str]:
    """Return numbers in place of cells that pandas left as text, if all are such.

    Returns:
        Numbers, or else text, their unit, and a cell that is no number where others are.
    """
    if cells.dtype.kind in "iuf":
        return cells, "", ""
    import pandas as pd

    first = str(cells[cells.first_valid_index()]).strip()
    if STAMP.fullmatch(first):
        return cells.astype(str), "", ""
    codes, values = pd.factorize(cells)  # each cell of text once
    text = pd.Series(values, dtype=str).str.strip()
    found = None if NUMBER.fullmatch(first) or len(text) == 1 else QUANTITY.fullmatch(first)
    unit = found["unit"] if found and text.str.endswith(found["unit"]).all() else ""
    text = text.str.removesuffix(unit).str.strip()
    decimal, thousands = decimal_mark([[cell for cell in text if NUMBER.fullmatch(cell)]])
    blanks = text[text.str.contains(BLANKS)].str.fullmatch(NUMBER).all()
    plain = text.str.replace(BLANKS, "", regex=True) if blanks else text
    if thousands:
        plain = plain.str.replace(thousands, "", regex=False)
    plain = plain.str.replace(decimal, ".", regex=False)
    plain = plain.str.replace(FORTRAN, "e", regex=True)
    numbers = pd.to_numeric(plain, errors="coerce")
    if not numbers.isna().any():
        every = np.append(numbers.to_numpy(np.float64), np.nan)  # the last one is of no code
        return pd.Series(every[codes]), unit, ""
    are_numbers = numbers.notna().any() or (text.str.match("0[xX]").any() and len(text) > 1)
    if not are_numbers or cells.isna().mean() > 0.5:  # remarks
        return cells, "", ""
    wrong = numbers.isna().to_numpy().argmax()
    return cells, "", f"{text[wrong]!r} at sample {(codes == wrong).argmax()}"
