"""Axes, times and rate out of all columns of a table."""

import math
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tex_lightning_runtime.column import IDS, MIN_RISING, SENSORS, SLOW, TIMES, Column, missing
from tex_lightning_runtime.errors import inflected
from tex_lightning_runtime.samples import Array, Channels
from tex_lightning_runtime.times import (
    EVEN,
    MIN_STAMPS,
    NOMINAL,
    SELDOM,
    TURNS,
    UNITS,
    Even,
    TableError,
    even_samples,
)

FILLERS, BEYOND = (999.0, 9999.0, 99999.0), 10  # in place of what is missing; times all others
MIN_ROW = 4  # samples in a line, or more, which may be of one signal
TAKE = re.compile(  # words of a name that numbers recordings; arr_0 may as well be their times
    r"(?:trial|run|rep|repetition|recording|stroke|take|swipe|sample|specimen|arr(?=-\d+-\d))-\d+"
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
    for column in columns:
        named = channels is None or bool({*column.words} & {*SENSORS, *IDS})
        if named and (kinds := column.interleaved):
            raise TableError(
                f"has rows of {kinds} kinds in turn by {_title(column)}; write each kind "
                "into a file of its own, or delete that column"
            )
    time, times, others = _time(columns, time_unit, rate)
    axes, left = _divided(columns, channels, time, others)
    if channels is not None:
        axes = _chosen(channels, axes, columns, left)
    blank = np.all([column.values.isna() for column in axes], axis=0)
    rows = ~blank if times is not None and not blank.all() else np.full(len(blank), True)
    samples = np.stack([_samples(column, rows) for column in axes])
    if channels is None:
        _check_alone(axes)
        _check_order(axes, samples)
    found, said = Even(samples, rate or 0.0), rate_from if rate else ""
    cut = []
    if not rows.all():
        bare = "without numbers in its axes"
        lines = inflected(int((~rows).sum()), f"line {bare} is", f"lines {bare} are")
        cut.append(f"{lines} left out")
    if times is not None and time is not None:
        once = ~_repeats(times[rows], samples)
        if not once.all():
            lines = inflected(
                int((~once).sum()),
                "line that repeats the one before is",
                "lines that repeat the one before are",
            )
            cut.append(f"{lines} left out")
        found = even_samples(times[rows][once], samples[:, once])
        said = f"times in {_title(time)}{found.said}"
        if rate and not math.isclose(found.rate, rate, rel_tol=NOMINAL):
            told = f"{rate:,.6g} Hz is stated above the table, and its times have {found.rate:,.6g}"
            found = found._replace(notes=(*found.notes, f"{told} Hz, which count"))
    names = tuple(column.name for column in axes) if axes[0].named else ()
    warned = [
        *(_warned(axes) if times is None else ()),
        *(_unlike(axes) if channels is None else ()),
    ]
    notes = (*cut, *warned, *_joined(columns), *found.notes)
    return found.samples, found.rate or None, Reading(names, said, left, notes)


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
                f"has {cell!r} in {_title(column)}, a number within text; write numbers alone, or "
                "choose the others by data.channels"
            )
    return axes, tuple(f"{_title(column)} ({why})" for column, why in reasons.items() if why)


def _warned(axes: list[Column]) -> list[str]:
    """Say of the first axis that rises all the time that it was not taken for time."""
    for axis in (a for a in axes if len(a.values) > MIN_RISING + 1):
        if axis.values.is_monotonic_increasing and axis.values.is_unique:
            how = "if it is time, call it time_s in the line of names, or time_us by its unit"
            return [f"{_title(axis)} rises at every sample and is read as an axis; {how}"]
    return []


def _check_alone(axes: list[Column]) -> None:
    """Reject recordings side by side, trial_1, trial_2, ..., or arr_0 and arr_1 of several axes."""
    found = {c: match[0] for c in axes if c.named and (match := TAKE.match("-".join(c.words)))}
    if len({*found.values()}) > 1:
        first, *_, last = map(_title, found)
        raise TableError(
            f"has several recordings in {first} to {last}; write each into a file of its own, or "
            "choose by data.channels"
        )


def _check_order(axes: list[Column], samples: Array) -> None:
    """Reject columns x0, x1, ... of samples (axes, samples) that are one signal, many a line.

    A line then goes on where the one before ended, while each column leaps from line to line.
    """
    groups: dict[str, list[int]] = defaultdict(list)
    for number, axis in enumerate(axes if axes[0].named else ()):
        groups[re.sub(r"\d+", "", axis.name)].append(number)
    for group in (g for g in groups.values() if len(g) >= MIN_ROW < samples.shape[1]):
        rows = samples[group]
        across, along = (np.abs(np.diff(rows, axis=n)).mean() for n in (0, 1))
        on = np.abs(rows[0, 1:] - rows[-1, :-1]).mean()
        if 0 < across < along / 2 and on < 1.5 * across:
            raise TableError(
                f"has one signal in {_title(axes[group[0]])} to {_title(axes[group[-1]])}, "
                f"{len(group)} samples a line; write one a line, or choose by data.channels"
            )


def _unlike(axes: list[Column]) -> list[str]:
    """Say how to leave out axes that by name or values are no signal, beside others that are.

    Of axes whose names differ in numbers alone, such as taxels, some may rest.
    """
    still = [(np.diff(axis.values, prepend=np.nan) == 0).mean() for axis in axes]
    words = [{*axis.words, *axis.units, "".join(axis.words[-2:])} for axis in axes]
    slow = [bool(SLOW & each) or axis.by_one for axis, each in zip(axes, words, strict=True)]
    kin = [re.sub(r"\d", "", axis.name) or axis.name for axis in axes]
    signals = {kin[n] for n, share in enumerate(still) if share < LIVELY and not slow[n]}
    odd = [
        n for n, share in enumerate(still) if kin[n] not in signals and (slow[n] or share > IDLE)
    ]
    if not signals or not odd:
        return []
    names = ", ".join(_title(axes[n]) for n in odd)
    kept = ",".join(str(n) for n in range(len(axes)) if n not in odd)
    return [
        f"read as axes, though unlike a signal: {names}; data.channels=[{kept}] leaves them out"
    ]


def _joined(columns: list[Column]) -> list[str]:
    """Say of columns that number recordings, or samples, that several of them are read as one."""
    return [
        f"{_title(column)} changes at sample {place}: what follows each other is read as one "
        "recording"
        for column in columns
        if column.named and (place := column.change)
    ]


def _title(column: Column) -> str:
    if not column.named:
        return f"column {column.name}"
    return f"{column.name!r} in {column.unit}" if column.unit else repr(column.name)


def _time(
    columns: list[Column], time_unit: str | None, rate: float | None
) -> tuple[Column | None, Array | None, list[Column]]:
    """Return the column of time, its seconds, and further ones; the finest is taken.

    Where a rate stands above the table, the first numbers that rise by its period are times, and
    times without a unit, or of few different stamps, are not needed.
    """
    broken = [c for c in columns if c.is_text and not c.is_stamp and TIMES & {*c.words}]
    failed = [column.no_times() for column in broken]
    parts = _fractions(columns)
    candidates = [column for column in columns if column.is_time or column in parts]
    seconds: dict[Column, Array] = {}
    for column in candidates:
        try:
            seconds[column] = parts[column] if column in parts else column.seconds(time_unit)
        except TableError as error:
            failed.append(error)
    if rate:
        rises = {column: np.count_nonzero(np.diff(times)) for column, times in seconds.items()}
        seconds = {c: times for c, times in seconds.items() if rises[c] >= MIN_STAMPS - 1}
    if seconds:
        time = min(seconds, key=lambda column: _unevenness(seconds[column]))
        _check_agreement(seconds, time)
        return time, seconds[time], [c for c in (*candidates, *broken) if c is not time]
    if failed and not rate:
        raise failed[0]
    first = next((c for c in columns if not c.is_text and c not in candidates), None)
    if first and rate:
        steps = np.diff(np.asarray(first.values, np.float64))
        if len(steps) > MIN_RISING and (np.abs(steps * rate - 1) < EVEN).all():
            again = [c for c in columns if c is not first and c.values.equals(first.values)]
            return first, np.append(0.0, np.cumsum(steps)), [*candidates, *again]
    return None, None, candidates


def _check_agreement(seconds: Mapping[Column, Array], time: Column) -> None:
    """Reject columns of other times than those that are taken, as two sensors side by side have."""
    for column, times in seconds.items():
        ends = times[-1], seconds[time][-1]
        repeated, _ = _unevenness(times)
        coarse = 2 * np.diff(times).max() if repeated else 0.0
        known = repeated < len(times) - MIN_RISING
        if known and not math.isclose(*ends, rel_tol=NOMINAL, abs_tol=coarse):
            raise TableError(
                f"has {ends[0]:.4g} s in {_title(column)} and {ends[1]:.4g} s in {_title(time)}; "
                "write each with its columns into a file of its own, or delete one of both"
            )


def _unevenness(times: Array) -> tuple[float, bool]:
    """Return how many times repeat, infinite if any is earlier, and whether steps usually differ.

    A sensor's own stamps are even; those of arrival are not.
    """
    steps = np.diff(times)
    repeated = float((steps == 0).sum()) if (steps >= 0).all() else math.inf
    step = float(np.median(steps)) if len(steps) else 0.0
    return repeated, bool((np.abs(steps - step) > EVEN * step).sum() > LIVELY * len(steps))


def _fractions(columns: list[Column]) -> dict[Column, Array]:
    """Return times that stand in several columns: seconds and nanoseconds, as ROS has them.

    Hours, minutes and seconds are such, and milliseconds beside a clock without fractions.
    """
    groups: dict[tuple[str, ...], dict[float, Column]] = defaultdict(dict)
    for column in columns:
        unit = "".join(column.words[-1:])
        if column.named and not column.is_text and len(unit) > 1 and unit in UNITS:
            groups[column.words[:-1]][UNITS[unit]] = column
    found: dict[Column, Array] = {}
    for parts in groups.values():
        if (times := _summed(parts)) is not None:
            found |= dict.fromkeys(parts.values(), times)
    for one, other in pairwise(c for c in columns if not c.named and not c.is_text):
        if one.is_time and (times := _summed({1.0: one, 1e-9: other})) is not None:
            found |= dict.fromkeys((one, other), times) if (np.diff(times) > 0).all() else {}
    whole = next((c for c in columns if c.is_time and c.is_text and not c.has_fractions), None)
    if whole is not None and whole not in found:
        for part, beside in groups[()].items():
            if beside not in found and (times := _summed({1.0: whole, part: beside})) is not None:
                found |= dict.fromkeys((whole, beside), times)
    return found


def _summed(parts: Mapping[float, Column]) -> Array | None:
    """Return the sum of times by their units in seconds, if each stays below the next larger."""
    units = sorted(parts, reverse=True)
    times = []
    for unit, larger in zip(units, [math.inf, *units], strict=False):
        column = parts[unit]
        values = column.seconds(None) if column.is_text else np.asarray(column.values)
        small = (values >= 0).all() and (values * unit < larger).all()
        if len(units) < 2 or not small or (unit != units[-1] and (values % 1).any()):
            return None
        times.append(unit * np.asarray(values - values[0], np.float64))
    total: Array = np.sum(times, axis=0)
    if turn := TURNS.get(units[0]):
        total += turn * np.cumsum(np.diff(total, prepend=total[:1]) < -turn / 2)
    return total


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
