"""Axes, times and rate out of all columns of a table."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tex_lightning_runtime.column import Column, missing
from tex_lightning_runtime.samples import Array, Channels
from tex_lightning_runtime.times import EVEN, Even, TableError, even_samples

MIN_RISING = 8  # samples; fewer numbers may rise by chance


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
