"""What the columns of a table mean, by their names: time, axes, and what is neither.

An index, a counter, an id and a label are left out, as is text; a rising column is time only if
its name says so. Without names all numbers are axes.
"""

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from tex_lightning_runtime.samples import Array, Channels
from tex_lightning_runtime.times import (
    EVEN,
    ONLY_DATE,
    STAMP,
    UNITS,
    Even,
    TableError,
    ask_unit,
    even_samples,
    number_seconds,
    stamp_seconds,
)

if TYPE_CHECKING:
    import pandas as pd

TIMES = {  # one of them makes a column one of time
    "time", "times", "timestamp", "timestamps", "datetime", "zeit", "zeiten", "zeitstempel",
    "uhrzeit", "temps", "tiempo", "tempo", "tijd", "czas", "epoch", "epoc", "elapsed", "时间",
    "時間", "время",
}  # fmt: skip
OF_TIME = {  # a name is one of time if all of its words are such
    *TIMES, *UNITS, "t", "date", "clock", "stamp", "unix", "ts", "since", "start", "boot", "utc",
    "system", "relative", "header", "field", "local", "in",
} - {"s", "d", "h", "min"}  # fmt: skip
NO_TIMES = {"flight", "constant", "delta", "diff", "dt", "exposure", "integration", "response"}
INDICES = {
    "index",
    "idx",
    "counter",
    "cnt",
    "seq",
    "sequence",
    "packet",
    "packets",
    "packetcounter",
}
NUMBERS = {"number", "num", "no", "nr", "count", "counts", "n", "i"}
COUNTED = {"sample", "samples", "row", "rows", "line", "frame", "frames", "record", "step", "point"}
LABELS = {"label", "labels", "class", "target", "activity", "category", "annotation", "groundtruth"}
STATES = {  # whole numbers so called are no measurement
    "surface", "material", "terrain", "texture", "user", "subject", "participant", "person",
    "trial", "session", "run", "group", "fold", "experiment", "series", "measurement", "event",
    "marker", "repetition", "rep", "block",
}  # fmt: skip
IDS = {"id", "ids", "uid", "uuid", "guid"}
NO_UNITS = re.compile(
    r"[-+\d:]*|utc|gmt|unix|epoch|txt|local|n|hh.*|yyyy.*|mm.*|dd.*|iso.*|since.*"
)
MIN_RISING = 8  # samples; fewer numbers may rise by chance
USUAL = 0.9  # of the steps of a counter, which may begin anew or miss some
UNNAMED = re.compile(r"(unnamed: \d+(_level_\d+)?(\.\d+)?)?")


@dataclass(frozen=True)
class Reading:
    """How a file was read.

    Attributes:
        axes: Names of the axes; empty if the file has none.
        rate_from: Where the rate stands; empty if the file does not state it.
        left_out: Columns that are no axes, and why.
        notes: What was skipped or filled in this file.
    """

    axes: tuple[str, ...] = ()
    rate_from: str = ""
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def said(self, *rates: float) -> str:
        """Say in one phrase what was read as what, with the rate in Hz or its range."""
        names = f"axes {', '.join(self.axes)}; " if self.axes else ""
        shown = dict.fromkeys(f"{float(f'{rate:.4g}'):,.6g}" for rate in rates)
        left = f"; left out: {', '.join(self.left_out)}" if self.left_out else ""
        return f"{names}{' to '.join(shown)} Hz by {self.rate_from}{left}"


@dataclass(eq=False)
class Column:
    """One column of a table.

    Attributes:
        name: Its name, or its number from 1.
        unit: Its cell in a row of units.
        values: Numbers (samples,), or cells of text.
        named: Whether the table has names.
        first: Whether it is the first one.
        fault: A cell of text in a column of numbers, and its place.
    """

    name: str
    unit: str
    values: "pd.Series[Any]"
    named: bool = True
    first: bool = False
    fault: str = ""
    words: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        self.words = split_words(self.name.partition("(")[0].partition("[")[0])

    @property
    def is_text(self) -> bool:
        """Whether its cells are text."""
        return self.values.dtype.kind not in "iuf"

    @property
    def is_stamp(self) -> bool:
        """Whether its cells are dates or clock times."""
        return self.is_text and _is(STAMP, self.values.iloc[0])

    @property
    def units(self) -> list[str]:
        """Units that name and row of units state, in small letters."""
        stated = [*re.findall(r"[(\[]([^)\]]*)[)\]]", self.name), self.unit.strip("()[] ")]
        if "/" in self.name:
            stated.append(self.name.rpartition("/")[2])
        return [each for each in map(_plain, stated) if each]

    @property
    def is_time(self) -> bool:
        """Whether its name, or its cells if there are no names, say that it is of time."""
        if self.is_stamp:
            return not _is(ONLY_DATE, self.values.iloc[0])
        words, units = {*self.words}, {*UNITS} - {*self.words[:1]}
        if self.is_text or not self.named or words & NO_TIMES:
            return False
        if words - units == {"t"}:  # or a temperature
            return all(unit in UNITS for unit in self.units) and self._rises()
        return bool(words & TIMES) or (bool(words) and words <= OF_TIME and self._rises())

    def reason(self) -> str:
        """Return why it is no axis; "" if it is one."""
        words = {*self.words} if self.named else set()
        if self.named and UNNAMED.fullmatch(self.name.casefold()) and self.first:
            return "index"
        if words & IDS:
            return "id"
        if words & {"label", "labels"}:
            return "label"
        if self.is_text:
            return "" if self.fault else "date" if self.is_stamp else "text"
        if not self.named:
            return ""
        if words & {"dt"} or {"delta", "t"} <= words:
            return "steps of time"
        few = max(1, len(self.values) // 10)
        if (
            (words and words <= LABELS | STATES)
            and self._is_whole()
            and self.values.nunique() <= few
        ):
            return "label"
        return "counter" if self._counts() else ""

    def _is_whole(self) -> bool:
        return self.values.dtype.kind in "iu" or bool((self.values % 1 == 0).all())

    def _rises(self) -> bool:
        steps = np.diff(np.asarray(self.values))
        return bool((steps >= 0).all() and steps.any())

    def _counts(self) -> bool:
        """Whether whole numbers are called and go up as those of a counter, or all stay."""
        words = {*self.words}
        called = self.name == "#" or words & (INDICES | NUMBERS | COUNTED)
        if not called or not self._is_whole():
            return False
        steps = np.diff(np.asarray(self.values, np.float64))
        if words & INDICES:  # several samples may have one number, and counters begin anew
            return not len(steps) or float((steps >= 0).mean()) > USUAL
        if not len(steps):
            return False
        usual = np.median(steps)
        if not words <= NUMBERS | COUNTED | STATES | LABELS | {"of", "sub", "logging"}:
            return False
        return bool((steps == usual).mean() > USUAL and (usual > 0 or not steps.any()))

    def seconds(self, time_unit: str | None) -> Array:
        """Return the times in seconds since the first.

        Raises:
            TableError: If they cannot be understood.
        """
        if self.is_text:
            try:
                return stamp_seconds(self.values)
            except (ValueError, OverflowError) as error:
                raise TableError(
                    f"has {self.values.iloc[0]!r} in the column {self.name!r}, and not all of its "
                    "cells can be read as such times; write them as 2026-03-01T10:00:00.000"
                ) from error
        unit = UNITS[time_unit] if time_unit else self._unit()
        values = np.asarray(self.values)
        if len(self.values) and not np.isfinite(values).all():
            raise missing(self, int(np.isfinite(values).argmin()))
        return number_seconds(values, unit, self.name)

    def _unit(self) -> float | None:
        """Return the unit of a time in seconds as name and row of units have it; None if not."""
        for unit in self.units:
            if unit in UNITS:
                return UNITS[unit]
            if not NO_UNITS.fullmatch(unit) and not {*split_words(unit)} <= OF_TIME:
                raise ask_unit(self.name, f"whose unit {unit!r} is not known")
        return next((UNITS[word] for word in reversed(self.words) if word in UNITS), None)


def split_words(name: str) -> tuple[str, ...]:
    """Return the words of a name in small letters, and its numbers: ``accX_2`` has three."""
    plain = unicodedata.normalize("NFKC", name)
    parts = re.sub(r"(?<=[a-zµμ])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", plain)
    return tuple(re.findall(r"[^\W\d_]+|\d+", parts.casefold()))


def _plain(unit: str) -> str:
    return unicodedata.normalize("NFKC", unit).casefold().strip(" .")


def _is(pattern: re.Pattern[str], cell: object) -> bool:
    return isinstance(cell, str) and pattern.fullmatch(cell.strip()) is not None


def missing(column: Column, place: int) -> TableError:
    """Return the error for a cell without a number."""
    return TableError(
        f"has no number in the column {column.name!r} at sample {place}; repair the recording, or "
        "choose other columns by data.channels"
    )


def separate(
    columns: list[Column], channels: Channels, time_unit: str | None, rate: float | None
) -> tuple[Array, float | None, Reading]:
    """Take the axes out of the columns of a table.

    Args:
        columns: All columns.
        channels: Which axes are kept; a name also keeps a column that would be left out.
        time_unit: Unit of times in numbers; None takes what the table says.
        rate: Rate in Hz that stands above the table, if there is one.

    Returns:
        Samples (axes, samples) float64, their rate in Hz or None, and how they were read.

    Raises:
        TableError: If there are no axes, or times or numbers cannot be understood.
    """
    time, times, others = _time(columns, time_unit)
    axes, left = _divided(columns, channels, time, others)
    if channels is not None:
        axes = _chosen(channels, axes, columns)
    samples = np.stack([_samples(column) for column in axes])
    found, said = Even(samples, rate or 0.0), "the lines above the table" if rate else ""
    if times is not None and time is not None:
        found = even_samples(times, samples)
        said = f"times in {_title(time)}{found.said}"
    names = tuple(column.name for column in axes) if axes[0].named else ()
    notes = (*(_warned(axes) if times is None else ()), *found.notes)
    return found.samples, found.rate or None, Reading(names, said, left, notes)


def _divided(
    columns: list[Column], channels: Channels, time: Column | None, others: list[Column]
) -> tuple[list[Column], tuple[str, ...]]:
    """Return the axes, and the names of columns that are none, with the reason."""
    chosen = [time, *(_find(each, columns) for each in channels or () if isinstance(each, str))]
    reasons = {c: "time" if c in others else c.reason() for c in columns if c not in chosen}
    counters = [column for column, why in reasons.items() if why == "counter"]
    axes = [c for c in columns if c is not time and not reasons.get(c)]
    if not axes:  # numbers that nothing else stands beside are measured
        axes, reasons = counters, {c: why for c, why in reasons.items() if c not in counters}
    if not axes:
        raise TableError("has no column of measured numbers; check its separator and its names")
    return axes, tuple(f"{_title(column)} ({why})" for column, why in reasons.items() if why)


def _warned(axes: list[Column]) -> list[str]:
    """Say of a first axis that rises evenly that it was not taken for time."""
    steps = np.diff(np.asarray(axes[0].values, np.float64))
    even = len(steps) > MIN_RISING and bool((abs(steps - steps.mean()) < EVEN * steps.mean()).all())
    how = "if it is time, call it time_s or time_ms"
    return [f"{_title(axes[0])} rises evenly and is read as an axis; {how}"] if even else []


def _title(column: Column) -> str:
    if not column.named:
        return f"column {column.name}"
    return f"{column.name!r} in {column.unit}" if column.unit else repr(column.name)


def _time(
    columns: list[Column], time_unit: str | None
) -> tuple[Column | None, Array | None, list[Column]]:
    """Return the column of time, its seconds, and further ones; the finest is taken."""
    found, failed = [], None
    parts = _fractions(columns)
    candidates = [column for column in columns if column.is_time or column in parts]
    for column in candidates:
        try:
            seconds = parts[column] if column in parts else column.seconds(time_unit)
        except TableError as error:
            failed = failed or error
            continue
        steps = np.diff(seconds)
        found.append(((steps <= 0).sum() if (steps >= 0).all() else np.inf, column, seconds))
    if not found:
        if failed:
            raise failed
        return None, None, []
    _, time, seconds = min(found, key=lambda each: each[0])
    return time, seconds, [column for column in candidates if column is not time]


def _fractions(columns: list[Column]) -> dict[Column, Array]:
    """Return times that stand in two columns: whole seconds and nanoseconds, as ROS has them."""
    found = {}
    numbers = [column for column in columns if column.named and not column.is_text]
    for whole in numbers:
        for part in numbers:
            if (
                whole.words[:-1] == part.words[:-1]
                and whole.words[-1:] in (("sec",), ("secs",))
                and part.words[-1:] in (("nsec",), ("nsecs",), ("nanosec",), ("nanosecs",))
            ):
                since = [np.asarray(c.values - c.values.iloc[0], np.float64) for c in (whole, part)]
                found[whole] = found[part] = since[0] + 1e-9 * since[1]
    return found


def _find(name: str, columns: list[Column]) -> Column:
    """Return the column of a name, perhaps without its unit or in other letters."""
    forms = (str, str.casefold, lambda text: re.split(r"[(\[/]", text.casefold())[0].strip(" _"))
    for form in forms:
        found = [column for column in columns if column.named and form(column.name) == form(name)]
        if len(found) > 1:
            raise TableError(f"has {len(found)} columns {name!r}; give their numbers, from 0")
        if found:
            return found[0]
    names = ", ".join(column.name for column in columns if column.named) or "no names"
    raise TableError(f"has no column {name!r} as data.channels asks for, but {names}")


def _chosen(
    channels: Sequence[int | str], axes: list[Column], columns: list[Column]
) -> list[Column]:
    last = max((each for each in channels if isinstance(each, int)), default=0)
    if last >= len(axes):
        raise TableError(
            f"has {len(axes)} channels, and data.channels names {last}, counted from 0; choose "
            "others"
        )
    return [_find(each, columns) if isinstance(each, str) else axes[each] for each in channels]


def _samples(column: Column) -> Array:
    if column.is_text:
        raise TableError(
            f"has {column.fault or 'text'} in the column {column.name!r}, and no number; correct "
            "it, or choose other columns by data.channels"
        )
    values = np.asarray(column.values, np.float64)
    if np.isnan(values).any():
        raise missing(column, int(np.isnan(values).argmax()))
    return values
