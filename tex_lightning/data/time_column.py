"""The column of time in a trace: it gives the rate and never becomes an axis."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tex_lightning.errors import UserError, listed, shorten

NAMES = ("time", "t", "timestamp", "zeit")
SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "\u03bcs", "usec", "microsecond", "microseconds"), 1e-6),
}
MIN_SAMPLES = 8  # fewer numbers may rise evenly by chance
MIN_RATE = 250.0  # Hz without a unit; what is slower is in ms or us, or counts samples
JITTER = 0.01  # of a step, up to which samples are taken as even
EVEN = 1.75  # steps, up to which a column without a name may be one of time
MAX_GAP = 10  # steps, up to which lost samples are interpolated

Array = npt.NDArray[np.floating]


@dataclass(frozen=True)
class RawTrace:
    """A trace as it stands in its file or files.

    Attributes:
        samples: (axes, samples); of a text file that has no times, in any order.
        rate: Rate in Hz if the file carries it, else None.
        timed: Whether a column of time gave the rate, and not a header.
        interpolated: Whether the times were uneven, or few samples lost, so that samples were
            interpolated.
    """

    samples: Array
    rate: float | None = None
    timed: bool = False
    interpolated: bool = False


def separate_time(
    path: Path,
    columns: Array,
    names: list[str] | None,
    units: list[str] | None,
    channel: int | None = None,
) -> RawTrace:
    """Take the column of time out of a table and derive the rate from it.

    Args:
        path: The file, for messages.
        columns: (samples, columns).
        names: Names of the columns, if the file has any.
        units: Units of the columns, if the file has any.
        channel: Number of the one column beside the time that is kept; None keeps all.

    Raises:
        UserError: If the times do not rise, have a gap or no plausible unit, or if what is left
            are not one or three axes.
    """
    found = _named_time(path, names, units) if names is not None else None
    if found is None:
        found = _unnamed_time(path, columns, names[0] if names else "")
    if found is None:
        columns = choose_channel(path, columns, channel)
        return RawTrace(columns[:, 0] if columns.shape[1] == 1 else columns)
    index, unit = found
    axes = choose_channel(path, np.delete(columns, index, axis=1), channel).T
    if len(axes) not in (1, 3):
        raise UserError(
            f"Trace {path} has {len(axes)} columns beside its time; a trace has one or three axes."
        )
    step, even = _step(path, columns[:, index], unit)
    if not even:
        grid = columns[0, index] + np.arange(len(columns)) * step / (unit or 1)
        axes = np.stack([np.interp(grid, columns[:, index], axis) for axis in axes])
    return RawTrace(axes, 1 / step, timed=True, interpolated=not even)


def choose_channel(path: Path, table: Array, channel: int | None) -> Array:
    """Keep one column of a table (samples, columns), or all of them if ``channel`` is None.

    Raises:
        UserError: If it has no such column.
    """
    if channel is None:
        return table
    if channel >= table.shape[1]:
        raise UserError(
            f"Trace {path} has {table.shape[1]} channels, and model.SENSE.decode.channel is "
            f"{channel}, counted from 0; choose another."
        )
    return table[:, [channel]]


def _named_time(
    path: Path, names: list[str], units: list[str] | None
) -> tuple[int, float | None] | None:
    """Index and unit in seconds of the column that is called time."""
    found: list[tuple[int, float | None]] = []
    for index, name in enumerate(names):
        words = _words(name)
        if len(words) == 1 and len(words[0]) > 2 and words[0] in SECONDS:  # "seconds"
            found.append((index, SECONDS[words[0]]))
        elif words and words[0] in NAMES:
            unit = words[1:] or (_words(units[index]) if units else [])
            if not unit:
                found.append((index, None))
            elif unit[0] in SECONDS and len(unit) == 1:
                found.append((index, SECONDS[unit[0]]))
            elif words[0] != "t":  # which may be a temperature
                raise UserError(
                    f"Trace {path} has a column {shorten(repr(name))} of unknown unit "
                    f"{shorten(repr(' '.join(unit)))}; call "
                    "it time_s, time_ms or time_us."
                )
    if len(found) > 1:
        raise UserError(
            f"Trace {path} has {len(found)} columns of time "
            f"({listed([names[index] for index, _ in found])}); keep one."
        )
    return found[0] if found else None


def _words(name: str) -> list[str]:
    return [word for word in re.findall(r"[^\W\d_]+", name.casefold()) if word != "in"]


def _unnamed_time(path: Path, columns: Array, name: str) -> tuple[int, None] | None:
    """The first column, if it has no name, rises evenly and stands before one or three others."""
    count = columns.shape[1]
    if count not in (2, 3, 4) or len(columns) < MIN_SAMPLES:
        return None
    steps = np.diff(columns[:, 0])
    if not (steps > 0).all() or steps.max() > EVEN * np.median(steps):
        return None
    if count == 3:  # whatever its name: no axis of a trace does that
        raise UserError(
            f"Trace {path} has three columns, of which the first rises evenly as time does; a "
            "trace has one or three axes beside a column of time."
        )
    return None if name else (0, None)


def _step(path: Path, times: Array, unit: float | None) -> tuple[float, bool]:
    """Mean step in seconds, and whether the steps are even.

    The mean and not the median: times are often rounded to few decimals.
    """
    steps = np.diff(times)
    if not len(steps) or not (steps > 0).all():
        place = int(np.argmin(steps > 0)) + 1 if len(steps) else 0
        raise UserError(
            f"Trace {path} has times that do not rise at sample {place}; correct the column, or "
            "delete it and give the rate of the file."
        )
    median = float(np.median(steps))
    if (widest := float(steps.max())) > MAX_GAP * median:
        raise UserError(
            f"Trace {path} has a gap in its column of time after sample {int(steps.argmax())}, "
            f"{widest / median:.3g} steps wide; cut the file there, or record it again."
        )
    step = float(times[-1] - times[0]) / len(steps)
    if unit is None and 1 / step < MIN_RATE:
        raise UserError(
            f"Trace {path} has {1 / step:.3g} samples a second if its column of time is in "
            "seconds; call it time_ms or time_us, or delete it if it counts samples."
        )
    return step * (unit or 1), bool((np.abs(steps - median) <= JITTER * median).all())
