"""Axes, times and rate out of all columns of a table."""

import math
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tex_lightning_runtime.column import (
    IDS,
    MIN_RISING,
    SENSORS,
    SLOW,
    Column,
    missing,
    mostly_rising,
    rising,
    split_words,
)
from tex_lightning_runtime.errors import inflected
from tex_lightning_runtime.samples import Array, Channels
from tex_lightning_runtime.time_columns import find_time
from tex_lightning_runtime.times import NOMINAL, SELDOM, Even, TableError, even_samples

FILLERS, BEYOND = (999.0, 9999.0, 99999.0), 10  # in place of what is missing; times all others
HEAD = 1 << 13  # samples that tell what an axis without a name is
MIN_ROW = 4  # samples in a line, or more, which may be of one signal
TAKE = re.compile(  # words of a name that numbers recordings; arr_0 may as well be their times
    r"\b(?:trial|run|rec|rep|repetition|recording|stroke|take|swipe|sample|specimen"
    r"|arr(?=-\d+-\d))-\d+|^latest\b"
)
IDLE, LIVELY = 0.75, 0.5  # shares of samples that equal the one before: of states, of signals


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
    columns: list[Column],
    channels: Channels,
    time_unit: str | None,
    rate: float | None,
    *,
    rate_from: str = "the lines above the table",
) -> tuple[Array, float | None, Reading]:
    """Take the axes out of the columns of a table.

    Args:
        columns: All columns.
        channels: Which axes are kept; a name also keeps a column that would be left out.
        time_unit: Unit of times in numbers; None takes what the table says.
        rate: Rate in Hz that stands above the table, if there is one.
        rate_from: Where else it stands.

    Returns:
        Samples (axes, samples) float64, their rate in Hz or None, and how they were read.

    Raises:
        TableError: If there are no axes, or times or numbers cannot be understood.
    """
    _check_turns(columns, channels)
    time, times, others = find_time(columns, time_unit, rate)
    axes, left = _divided(columns, channels, time, others)
    if channels is not None:
        axes = _chosen(channels, axes, columns, left)
    blank = np.all([column.values.isna() for column in axes], axis=0)
    rows = ~blank if times is not None and not blank.all() else np.full(len(blank), True)
    if not rows.all():  # where another column of time may be whole
        find_time([replace(c, values=c.values[rows]) for c in columns], time_unit, rate)
    samples = np.stack([_samples(column, rows) for column in axes])
    if channels is None:
        _check_alone(axes)
        _check_order(axes, samples)
    found, said = Even(samples, rate or 0.0), rate_from if rate else ""
    bare = "without numbers in its axes"
    cut = _left_out(~rows, f"line {bare} is", f"lines {bare} are")
    if times is not None and time is not None:
        again = _repeats(times[rows], samples)
        before = "the one before"
        cut += _left_out(again, f"line that repeats {before} is", f"lines that repeat {before} are")
        found = even_samples(times[rows][~again], samples[:, ~again])
        said = f"times in {time.title}{found.said}"
        if rate and not math.isclose(found.rate, rate, rel_tol=NOMINAL):
            told = f"{rate:,.6g} Hz is stated above the table, and its times have {found.rate:,.6g}"
            found = found._replace(notes=(*found.notes, f"{told} Hz, which count"))
    names = tuple(column.name for column in axes) if axes[0].named else ()
    warned = [
        *(_warned(columns, axes) if times is None else ()),
        *(_unlike(axes, timed=times is not None) if channels is None else ()),
    ]
    notes = (*cut, *warned, *_joined(columns), *found.notes)
    return found.samples, found.rate or None, Reading(names, said, left, notes)


def _left_out(lines: Array, one: str, several: str) -> list[str]:
    """Say how many lines are left out, if any are."""
    count = int(lines.sum())
    return [f"{inflected(count, one, several)} left out"] if count else []


def _repeats(times: Array, samples: Array) -> Array:
    """Return which samples are those of the line before, written twice.

    Samples within one coarse time differ, or rest between times as well.
    """
    again = np.diff(times) == 0
    same = (np.diff(samples) == 0).all(axis=0)
    twice = again.any() and same[again].all() and same[~again].mean() < SELDOM
    return np.append(False, again & bool(twice))


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
        raise TableError(
            "has no column of measured numbers; check its separator and its names, or choose by "
            "data.channels"
        )
    for column in (c for c, why in reasons.items() if why == "text" and channels is None):
        if cell := column.hidden:
            raise TableError(
                f"has {cell!r} in {column.title}, a number within text; write numbers alone, or "
                "choose the others by data.channels"
            )
    return axes, tuple(f"{column.title} ({why})" for column, why in reasons.items() if why)


def _warned(columns: list[Column], axes: list[Column]) -> list[str]:
    """Say of the first axis, or index of fractions, that rises that it was not taken for time."""
    for column in (c for c in columns if len(c.values) > MIN_RISING + 1 and not c.is_text):
        index = column not in axes and column.reason() == "index" and not column.is_whole
        rises = column.values.is_monotonic_increasing and column.values.nunique() > MIN_RISING
        if rises and (index or column in axes):
            how = "left out as an index" if index else "read as an axis"
            moves = "rises at every sample" if column.values.is_unique else "never falls"
            name = "if it is time, call it time_s in the line of names, or time_us by its unit"
            return [f"{column.title} {moves} and is {how}; {name}"]
    return []


def _check_turns(columns: list[Column], channels: Channels) -> None:
    """Reject rows of several sensors in turn; of chosen axes only by a column so named."""
    for column in columns:
        named = channels is None or bool({*column.words} & {*SENSORS, *IDS})
        if named and (kinds := column.interleaved):
            raise TableError(
                f"has rows of {kinds} kinds in turn by {column.title}; write each kind "
                "into a file of its own, or delete that column"
            )


def _check_alone(axes: list[Column]) -> None:
    """Reject recordings side by side, trial_1, trial_2, ..., or arr_0 and arr_1 of several axes."""
    named = {c: "-".join(split_words(c.name)) for c in axes if c.named}
    found = {c: match[0] for c, name in named.items() if (match := TAKE.search(name))}
    if len({*found.values()}) > 1 and len({c.array or c.name for c in found}) > 1:
        first, *_, last = (column.title for column in found)
        raise TableError(
            f"has several recordings in {first} to {last}; write each into a file of its own, or "
            "choose by data.channels"
        )


def _check_order(axes: list[Column], samples: Array) -> None:
    """Reject columns x0, x1, ... of samples (axes, samples) that are one signal, many a line.

    A line then goes on where the one before ended, while each column leaps from line to line.
    """
    groups: dict[str, list[int]] = defaultdict(list)
    for number, axis in enumerate(axes):
        groups[re.sub(r"\d+", "", axis.name)].append(number)
    for group in (g for g in groups.values() if len(g) >= MIN_ROW < samples.shape[1]):
        rows = samples[group]
        across, along = (np.abs(np.diff(rows, axis=n)).mean() for n in (0, 1))
        on = np.abs(rows[0, 1:] - rows[-1, :-1]).mean()
        if 0 < across < along / 2 and on < 1.5 * across:
            raise TableError(
                f"has one signal in {axes[group[0]].title} to {axes[group[-1]].title}, "
                f"{len(group)} samples a line; write one a line, or choose by data.channels"
            )


def unlike_axes(samples: Array) -> list[str]:
    """Say of axes (axes, samples) without names which of them are unlike a signal."""
    head = samples[:, :HEAD] if len(samples) > 1 else samples[:0]  # beside others alone
    axes = [Column(str(n), "", values, named=False) for n, values in enumerate(head, 1)]
    return _unlike(axes, timed=True) if np.isfinite(head).all() else []


def _unlike(axes: list[Column], *, timed: bool) -> list[str]:
    """Say how to leave out axes that by name or values are no signal, beside others that are.

    Of axes whose names differ in numbers alone, such as taxels, some may rest. What rises evenly
    where times are known (``timed``) may be another clock, and what falls evenly counts down.
    """
    still = [(np.diff(axis.values, prepend=np.nan) == 0).mean() for axis in axes]
    words = [{*axis.words, *axis.units, "".join(axis.words[-2:])} for axis in axes]
    counts = all(axis.is_whole for axis in axes)
    slow = [
        bool(SLOW & each and axis.words != ("hz",))  # of a magnetic field
        or axis.by_one
        or (axis.is_code and not counts)
        or _ramps(np.asarray(axis.values), timed=timed)
        or (timed and not axis.named and mostly_rising(np.asarray(axis.values)))
        for axis, each in zip(axes, words, strict=True)
    ]
    kin = [re.sub(r"\d", "", axis.name) or axis.name for axis in axes]
    signals = {kin[n] for n, share in enumerate(still) if share < LIVELY and not slow[n]}
    odd = [
        n for n, share in enumerate(still) if kin[n] not in signals and (slow[n] or share > IDLE)
    ]
    if not signals or not odd:
        return []
    names = ", ".join(axes[n].title for n in odd)
    kept = ",".join(str(n) for n in range(len(axes)) if n not in odd)
    return [
        f"read as axes, though unlike a signal: {names}; data.channels=[{kept}] leaves them out"
    ]


def _ramps(values: Array, *, timed: bool) -> bool:
    """Return whether values fall evenly, or rise so beside known times, as no signal does."""
    return rising(-values) or (timed and rising(values))


def _joined(columns: list[Column]) -> list[str]:
    """Say of columns that number recordings, or samples, that several of them are read as one."""
    return [
        f"{column.title} changes at sample {place}: what follows each other is read as one "
        "recording"
        for column in columns
        if (place := column.change)
    ]


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
    channels: Sequence[int | str], axes: list[Column], columns: list[Column], left: Sequence[str]
) -> list[Column]:
    last = max((each for each in channels if isinstance(each, int)), default=0)
    if last >= len(axes):
        beside = f" beside {', '.join(left)}" if left else ""
        raise TableError(
            f"has {len(axes)} channels{beside}, and data.channels names {last}, counted from 0; "
            "choose others"
        )
    return [_find(each, columns) if isinstance(each, str) else axes[each] for each in channels]


def _samples(column: Column, rows: Array) -> Array:
    if column.is_text:
        raise column.no_number()
    values = np.asarray(column.values, np.float64)
    if np.isnan(values[rows]).any():
        raise missing(column, int(np.isnan(values).argmax()))
    sizes = np.abs(values[rows])
    top = sizes.max(initial=0.0)
    if top in FILLERS and top > BEYOND * sizes.max(initial=0.0, where=sizes < top) > 0:
        place = int((np.abs(values) == top).argmax())
        raise missing(column, place, f"{values[place]:g} in place of a number")
    return values[rows]
