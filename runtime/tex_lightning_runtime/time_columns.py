"""The times among the columns of a table: the finest of several, or the sum of parts of one."""

import math
from collections import defaultdict
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from tex_lightning_runtime.column import MIN_RISING, TIMES, Column
from tex_lightning_runtime.samples import Array
from tex_lightning_runtime.times import EPOCH, EVEN, MIN_STAMPS, NOMINAL, TURNS, UNITS, TableError


def find_time(
    columns: list[Column], time_unit: str | None, rate: float | None
) -> tuple[Column | None, Array | None, list[Column]]:
    """Return the column of time, its seconds, and further ones; the finest is taken.

    Where a rate stands above the table, numbers that rise by its period are times, and times
    without a unit, or of few different stamps, are not needed.
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
    for column in (c for c in columns if rate and c not in candidates and _rises_by(c, 1 / rate)):
        again = [c for c in columns if c is not column and c.values.equals(column.values)]
        return column, np.asarray(column.values - column.values.iloc[0]), [*candidates, *again]
    return None, None, candidates


def _rises_by(column: Column, period: float) -> bool:
    """Return whether a column rises by a period at every sample."""
    if column.is_text:
        return False
    steps = np.diff(np.asarray(column.values, np.float64))
    return len(steps) > MIN_RISING and bool((np.abs(steps / period - 1) < EVEN).all())


def _check_agreement(seconds: Mapping[Column, Array], time: Column) -> None:
    """Reject columns of other times than those that are taken, as two sensors side by side have."""
    for column, times in seconds.items():
        ends = times[-1], seconds[time][-1]
        repeated, _ = _unevenness(times)
        coarse = 2 * np.diff(times).max() if repeated else 0.0
        known = repeated < len(times) - MIN_RISING
        if known and not math.isclose(*ends, rel_tol=NOMINAL, abs_tol=coarse):
            raise TableError(
                f"has {ends[0]:.4g} s in {column.title} and {ends[1]:.4g} s in {time.title}; "
                "write each with its columns into a file of its own, or delete one of both"
            )


def _unevenness(times: Array) -> tuple[float, bool]:
    """Return how many times repeat, infinite if any is earlier or all are, and if steps differ.

    A sensor's own stamps are even; those of arrival are not.
    """
    steps = np.diff(times)
    still = len(steps) > 0 and not steps.any()
    repeated = float((steps == 0).sum()) if (steps >= 0).all() and not still else math.inf
    step = float(np.median(steps)) if len(steps) else 0.0
    uneven = (np.abs(steps - step) > EVEN * step).sum() > 0.5 * len(steps)
    return repeated, bool(uneven or still)


def _fractions(columns: list[Column]) -> dict[Column, Array]:
    """Return times that stand in several columns: seconds and nanoseconds, as ROS has them.

    Hours, minutes and seconds are such, and milliseconds beside a clock without fractions.
    """
    groups: dict[tuple[str, ...], dict[float, Column]] = defaultdict(dict)
    for column in columns:
        unit = "".join(column.words[-1:])
        long = len(unit) > 1 or (unit == "s" and len(column.words) > 1)
        if column.named and not column.is_text and long and unit in UNITS:
            groups[column.words[:-1]][UNITS[unit]] = column
    found: dict[Column, Array] = {}
    for parts in groups.values():
        if (times := _summed(parts)) is not None:
            found |= dict.fromkeys(parts.values(), times)
    for one, other in pairwise(c for c in columns if not c.named and not c.is_text):
        seconds = one.is_time and one.values.iloc[0] < EPOCH[1]
        if seconds and (times := _summed({1.0: one, 1e-9: other})) is not None:
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
