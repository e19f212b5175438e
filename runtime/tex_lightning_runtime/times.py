"""Times of samples as programs write them: to seconds, and samples to even steps.

Times are numbers of a unit, or stamps: ISO dates, dates of other countries, clock times.
"""

import re
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tex_lightning_runtime.resampling import MAX_RATE, MIN_RATE
from tex_lightning_runtime.samples import Array

if TYPE_CHECKING:
    import pandas as pd

UNITS = {  # in seconds
    name: seconds
    for seconds, names in {
        1.0: "s sec secs second seconds sekunden sek secondes secondi segundos с сек 秒 초",
        1e-3: "ms msec msecs millis millisec millisecond milliseconds millisekunden milli мс 毫秒"
        " 밀리초",
        1e-6: "us \u03bcs usec usecs micros microsec microsecond microseconds mikrosekunden micro"
        " мкс 微秒",
        1e-9: "ns nsec nsecs nanos nanosec nanosecs nanosecond nanoseconds nano",
        60.0: "min mins minute minutes minuten",
        3600.0: "h hr hrs hour hours",
        86_400.0: "d day days",
    }.items()
    for name in names.split()
}
EPOCH = (9e8, 4.2e9)  # seconds since 1970: 1998 to 2103
OTHER_EPOCHS = {  # 1998 to 2103 in other units of seconds
    (35_796, 74_511): 86_400.0,  # days of Excel
    (729_756, 768_471): 86_400.0,  # and of MATLAB
    (1.25e17, 1.59e17): 1e-7,  # ticks of Windows
    (6.30e17, 6.63e17): 1e-7,  # and of .NET
}
DAY, HOUR = 86_400.0, 3600.0
TURNS = {HOUR: DAY, 60.0: HOUR}  # seconds after which hours and minutes begin anew
MIN_STAMPS = 5  # different ones that repeat; the rate by fewer may be off by a fifth
NOMINAL = 0.1  # by which sensors differ from their rate
EVEN = 0.01  # of a step, up to which samples stay as they are
GAP = 2.5  # steps, above which samples are missing; times rounded to few digits reach 2
UNEVEN = 0.25  # of the steps, which differ by half from the mean if samples are events
LARGE_GAP = 10  # steps, from which on it is said
MAX_FILLED = 2  # times as many samples, beyond which most of a recording would be made up
SELDOM = 0.1  # of the samples, at which a clock begins anew
MAX_DRIFT = 0.05  # of the duration, by which repeated times may lie beside even ones
DATE = (
    r"(?:\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{2,4}"
    r"|\d{1,2}[-/. ][^\W\d_]{3,9}\.?[-/. ]\d{2,4})"  # 07-May-2026
)
DAYS = r"(?:\d+ days?,?)"  # of pandas and Python
CLOCK = r"\d{1,4}:\d{1,2}(?::\d{1,2})?(?:[.,:]\d+)?"
DOTTED = r"(?<=\d[T\s])(\d{1,2})\.(\d\d)\.(?=\d\d)"  # behind a date, in Denmark and Finland
ZONE = r"(?:\s*(?:[AaPp]\.?[Mm]\.?|Z|UTC|GMT|[-+]\d{2}(?::?\d{2})?|\[[\w/+-]+\]))*"
STAMP = re.compile(
    rf"(?:\d{{8}}T\d{{6}}(?:[.,]\d+)?{ZONE}|{DATE}(?:[T\s,]\s*(?:{CLOCK}|{DOTTED}\d\d(?:[.,]\d+)?){ZONE})?|(?:{DAYS}\s+)?{CLOCK}{ZONE}(?:\s+{DATE})?)"
)
MARKS = r"(?<=:\d\d),(?=\d)|(?<=:\d\d:\d\d):(?=\d)"  # of fractions: 10:00:00,500
SHORT = re.compile(r"(?<=:\d\d)\.(\d\d?)(?!\d)")  # milliseconds, as .5 and .15 of 5 and 15
ONLY_DATE = re.compile(DATE)


class TableError(ValueError):
    """What is wrong with a table, and the remedy: a predicate that follows the name of its file."""


class Even(NamedTuple):
    """Samples (axes, samples) at even steps, their rate in Hz, and what there is to say."""

    samples: Array
    rate: float
    said: str = ""  # of the rate
    notes: tuple[str, ...] = ()


def stamp_seconds(stamps: "pd.Series[str]") -> Array:
    """Return the seconds since the first of dates and clock times, which may pass midnight.

    Raises:
        ValueError: If pandas cannot read them.
    """
    import pandas as pd

    text = stamps if stamps.iloc[0] == stamps.iloc[0].strip() else stamps.str.strip()
    if re.search(DOTTED, text.iloc[0]):
        text = text.str.replace(DOTTED, r"\1:\2:", regex=True)
    if re.search(MARKS, text.iloc[0]):
        text = text.str.replace(MARKS, ".", regex=True)
    if re.match(r"\d{4}-\d\d-\d\d|\d{8}T", text.iloc[0]):
        if re.search(r"[]TC]$", text.iloc[0]):  # of names of zones
            text = text.str.replace(r"\s*(?:UTC|GMT|\[.+\])$", "", regex=True)
        moments = pd.to_datetime(text, format="ISO8601", utc=True)
        seconds = np.asarray((moments - moments.iloc[0]).dt.total_seconds(), np.float64)
    else:
        seconds = _clock_seconds(text)
    if (np.diff(seconds) >= 0).all():
        return seconds
    padded = text.str.replace(SHORT, lambda found: f".{found[1]:0>3}", regex=True)
    whole = seconds if padded.equals(text) else stamp_seconds(padded)
    return whole if (np.diff(whole) >= 0).all() else seconds


def _clock_seconds(text: "pd.Series[str]") -> Array:
    """Read clock times, perhaps behind dates: only differences count, of less than half a turn."""
    import pandas as pd

    turn = DAY / 2 if re.search(r"[AaPp]\.?[Mm]", re.sub(DATE, "", text.iloc[0])) else DAY
    text = text.str.extract(rf"({CLOCK})", expand=False)
    if not re.match(r"\d+:\d\d:", str(text.iloc[0])):  # minutes and seconds, as Excel shows them
        text, turn = "00:" + text, HOUR
    seconds = np.asarray(pd.to_timedelta(text).dt.total_seconds(), np.float64) % turn
    falls = -np.diff(seconds, prepend=seconds[:1])
    if turn == DAY and seconds.max() < 13 * HOUR and DAY / 2 - 60 < falls.max() <= DAY / 2:
        seconds, turn = seconds % (DAY / 2), DAY / 2  # 12:59:59 to 1:00:00, without AM and PM
        falls = -np.diff(seconds, prepend=seconds[:1])
    return np.asarray(seconds - seconds[0] + turn * np.cumsum(falls > turn / 2))


def number_seconds(values: Array, unit: float | None, name: str) -> Array:
    """Return times in seconds since the first of numbers.

    Without a unit, moments since 1970 have the one that puts them into this century, and others
    are seconds if that gives the rate of a signal, or else days of Excel or MATLAB, or ticks of
    100 ns.

    Args:
        values: Numbers; whole ones are subtracted exactly.
        unit: Seconds of one, if it is known.
        name: Column, for the message.

    Raises:
        TableError: If the unit has to be asked for.
    """
    since = np.asarray(_begun_anew(values) - values[0], np.float64)
    unit = unit or _moment_unit(values)
    if unit is None:
        steps = np.diff(since)  # gaps and repetitions apart
        step = float(np.median(steps) or steps.mean()) if len(steps) else 0.0
        units = (1.0, *(u for (a, b), u in OTHER_EPOCHS.items() if a < values[0] < b))
        fits = (u for u in units if not step or MIN_RATE <= 1 / abs(step * u) <= MAX_RATE)
        unit = next(fits, None)
        if unit is None:
            raise ask_unit(name, f"which rises by {step:.6g} a sample, has no unit")
    return since * unit


def _moment_unit(values: Array) -> float | None:
    """Return the unit in seconds of numbers that may be moments since 1970, and no rare ones."""
    first, step = float(values[0]), abs(float(values[-1] - values[0])) / len(values)
    units = (u for u in (1.0, 1e-3, 1e-6, 1e-9) if step * u < 60)  # others count ticks
    return next((u for u in units if EPOCH[0] < first * u < EPOCH[1]), None)


def are_moments(values: Array) -> bool:
    """Return whether numbers are moments since 1970 of a signal, whatever they are called."""
    unit = _moment_unit(values)
    if unit is None or not (np.diff(values) >= 0).all():
        return False
    return bool(0 < (values[-1] - values[0]) * unit < len(values) / MIN_RATE)


def _begun_anew(values: Array) -> Array:
    """Return whole numbers of a clock of 16 to 32 bits without the places where it is full."""
    steps = np.diff(values, prepend=values[:1])
    falls, turn = steps < 0, 2.0 ** np.ceil(np.log2(max(-steps.min(initial=0), 1)))
    if not (0 < falls.mean() < SELDOM and 1 << 16 <= turn <= 1 << 32):
        return values
    whole: Array = values + int(turn) * np.cumsum(falls)
    steps = np.diff(whole)
    full = (steps >= 0).all() and (steps[falls[1:]] < GAP * np.median(steps)).all()
    return whole if full else values


def ask_unit(name: str, fault: str) -> TableError:
    """Return the error for a column of time whose unit is not known."""
    return TableError(
        f"has the column of time {name!r}, {fault}; give data.time_unit=ms (or s, us, ns, "
        "min, h, d), or call it time_ms"
    )


def even_samples(times: Array, samples: Array) -> Even:
    """Interpolate samples (axes, samples) linearly at even steps.

    The step is the mean of all that are no gaps: times are often rounded to few digits, so that
    their median is none. Times that are so coarse that they repeat give the rate alone.

    Raises:
        TableError: If the times do not rise, or most samples are missing.
    """
    steps = np.diff(times)
    if not steps.any():
        fault = "that do not rise at all, too coarse" if len(steps) else "of one sample, too few"
        raise TableError(
            f"has times {fault} for the rate; delete that column and give data.file_rate"
        )
    if not (steps >= 0).all():
        raise TableError(
            f"has times that do not rise at sample {int(np.argmin([*(steps >= 0), False])) + 1}; "
            "divide it there if a recording begins anew, correct them, or delete that column and "
            "give data.file_rate"
        )
    if not (steps > 0).all():
        return _repeated(times, samples)
    if rate := _rounded_rate(times, steps):
        return Even(samples, rate)
    drift, even = _line(np.arange(len(times)), times)
    if _are_late(steps) and drift < MAX_DRIFT * (times[-1] - times[0]):
        return Even(samples, 1 / even, ", some of which are late", _closed(steps, steps))
    step = float(steps[~_gaps(steps)].mean())
    count = round(float(times[-1] - times[0]) / step) + 1
    largest, notes = float(steps.max()), tuple[str, ...]()
    if count > MAX_FILLED * len(times):
        raise TableError(
            f"has times with gaps of up to {largest / step:,.0f} steps, so that most samples are "
            "missing; divide it there, or delete that column and give data.file_rate"
        )
    told = f"gaps in its times, the largest of {largest:.3g} s after sample {steps.argmax()}"
    if uneven := np.quantile(np.abs(steps - step), 1 - UNEVEN) > step / 2:
        told = f"uneven steps of its times, {steps.min():.3g} to {largest:.3g} s"
    if uneven or largest > LARGE_GAP * step:
        notes = (f"{told}, are filled with straight lines",)
    if (np.abs(steps - step) > EVEN * step).any():
        grid = times[0] + np.arange(count) * step
        samples = np.stack([np.interp(grid, times, axis) for axis in samples])
    return Even(samples, 1 / step, "", notes)


def _gaps(steps: Array) -> Array:
    """Return which steps (samples,) are gaps: if all are multiples of one, more than this one."""
    usual = np.median(steps)
    multiples = np.round(steps / usual)
    lost = np.mean(multiples > 1) < SELDOM
    even = (np.abs(steps - multiples * usual) < EVEN * usual).all()
    return np.asarray(multiples > 1 if even and lost else steps > GAP * usual)


def _are_late(steps: Array) -> bool:
    """Return whether long steps are of samples that came late, since hurried ones make up for them.

    Nothing makes up for the time of samples that are missing.
    """
    usual = float(np.median(steps))
    lost, made_up = (steps - usual)[steps > GAP * usual], (usual - steps)[GAP * steps < usual]
    return bool(2 * made_up.sum() > lost.sum() > 0)


def _rounded_rate(times: Array, steps: Array) -> float | None:
    """Return the rate of even times that are rounded, so that two steps occur; None if they differ.

    Both steps are multiples of what the times are rounded to, by which they differ. A double step
    that is seldom is one of a sample that is missing.
    """
    low, high = float(steps.min()), float(steps.max())
    unit, close = high - low, EVEN * high
    two = unit > close and bool((np.minimum(steps - low, high - steps) < close).all())
    if not two or (unit > low / 2 and (steps > low + close).mean() < SELDOM):
        return None
    drift, step = _line(np.arange(len(times)), times)
    return 1 / step if abs(low - unit * round(low / unit)) < close and drift < unit else None


def _line(places: Array, times: Array) -> tuple[float, float]:
    """Return by how much times at most leave a straight line over their places, and its slope."""
    line = np.polyfit(places, times, 1)
    return float(np.abs(times - np.polyval(line, places)).max()), float(line[0])


def _repeated(times: Array, samples: Array) -> Even:
    """Take samples for even whose times are rounded to more than a step, or are of arrival."""
    rises = np.diff(times)
    last = np.flatnonzero(rises)  # of each time, where it is that of arrival; else the first counts
    if len(last) < MIN_STAMPS - 1:
        raise TableError(
            f"has times that repeat within {rises.max():.3g} s, too coarse for the rate; delete "
            "that column and give data.file_rate"
        )
    drift, step = min(_line(places, times[places]) for places in (last, last + 1))
    if drift > max(MAX_DRIFT * (times[-1] - times[0]), 1.5 * rises[rises > 0].min()):
        raise TableError(
            f"has times that repeat at sample {int(np.argmin(rises)) + 1} and leave gaps "
            "elsewhere; correct them, or delete that column and give data.file_rate"
        )
    said = f", which repeat within {rises.max():.3g} s"
    return Even(samples, 1 / step, said, _closed(rises, rises[rises > 0]))


def _closed(steps: Array, usual: Array) -> tuple[str, ...]:
    """Say of the largest step that it is a gap which is closed, if it is far beyond usual ones."""
    gap, place = float(steps.max()), steps.argmax()
    told = f"gaps in its times, the largest of {gap:.3g} s after sample {place}, are closed"
    return (told,) if gap > GAP * np.quantile(usual, 1 - SELDOM) else ()
