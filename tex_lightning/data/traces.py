"""Signals out of files: samples (axes, samples) as they stand there, and their rate.

A signal has 1 to 64 axes; whatever the file, the longer dimension of its samples is time.

Sounds and NumPy arrays are read by their libraries. Text has one sample a line, in columns that
stand apart by semicolon, tab, comma or space; understood are decimal commas beside the others,
comment lines that begin with ``#`` or ``%``, lines of names above the numbers and a column of time.

A column of time gives the rate and never becomes an axis. It is called ``time``, ``t`` or the like,
or it is the first of several columns and rises throughout. Where its steps are uneven or samples
are missing, the others are interpolated linearly to even steps of the usual length.
"""

import logging
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import soundfile

from tex_lightning.core.console import suppress_warnings
from tex_lightning.core.files import check_lines, is_file, require_file
from tex_lightning.errors import UserError, reason, shorten

Array = npt.NDArray[np.floating]
MAX_AXES = 64
MAX_SAMPLES = 1 << 29  # of a file, 2 GiB of float32: 14 h of one axis at 10 kHz
MAX_TEXT = 1 << 29  # bytes
CUT = re.compile(r"data : (\d+) \(should be (\d+)\)")  # libsndfile's note of a truncated file
UNKNOWN_LENGTH = 0x7FFF0000  # programs that stream write such a length for want of a better one
DAMAGE = (soundfile.SoundFileError, ValueError, EOFError, OSError, LookupError, MemoryError)
MARKS = "#%"  # of comments
DELIMITERS = (";", "\t", ",")  # the first in a line of numbers; else white space
TIMES = ("time", "timestamp", "t", "zeit", "sec", "seconds", "milliseconds")  # names begin so
SECONDS = {
    **dict.fromkeys(("s", "sec", "second", "seconds", *TIMES[:4]), 1.0),
    **dict.fromkeys(("ms", "msec", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "\u03bcs", "usec", "microseconds"), 1e-6),
}
MIN_RISING = 8  # samples; fewer numbers may rise by chance
EVEN = 0.01  # of a step, up to which samples stay as they are
MISSING = 2.5  # steps, above which samples are missing; times rounded to few digits reach 2
LARGE_GAP = 10  # steps, from which on a warning names it
MAX_FILLED = 2  # times as many samples, beyond which most of a recording would be made up

log = logging.getLogger(__name__)


Table = tuple[Array, float | None]  # samples in the order of the file, and its rate in Hz


def read_samples(path: Path, channels: Sequence[int] | None = None) -> Table:
    """Read the samples (axes, samples) out of one file, or three with an axis each.

    Args:
        path: The file, or any of the three (:func:`axis_files`).
        channels: Which of the axes are kept, as :func:`choose_channels` takes them.

    Returns:
        Samples of 1 to 64 axes, and their rate in Hz; None if the file does not state it.

    Raises:
        UserError: If a file is missing, empty, damaged or of another shape, or its column of time
            cannot be used.
    """
    parts = [_read_file(file) for file in axis_files(path)]
    samples, rate = parts[0] if len(parts) == 1 else _join_axes(path, parts)
    return choose_channels(samples, channels, f"Trace {path}"), rate


def _join_axes(path: Path, parts: list[Table]) -> Table:
    shapes = [samples.shape for samples, _ in parts]
    rates = {rate for _, rate in parts}
    if {*shapes} != {(1, shapes[0][1])} or len(rates) > 1:
        raise UserError(
            f"The axes X, Y, Z of trace {path} have the shapes {', '.join(map(str, shapes))}; each "
            "must be a single one, and all of one length and rate."
        )
    return np.concatenate([samples for samples, _ in parts]), rates.pop()


def axis_files(path: Path) -> tuple[Path, ...]:
    """List the files of one recording: three if its axes lie apart, as in LMT-108, else itself.

    Files are axes of one recording if their names differ in ``_X_``, ``_Y_``, ``_Z_`` before the
    last part of the name (``G1Mesh_Movement_X_train1.txt``). Any of the three stands for all, and
    all are needed if there are two.
    """
    match = re.fullmatch(r"(.+_)[XYZ](_[^_]+)", path.name)
    if match is None or path.suffix.lower() not in TRACE_SUFFIXES:
        return (path,)
    files = tuple(path.with_name(f"{match[1]}{axis}{match[2]}") for axis in "XYZ")
    return files if sum(map(is_file, files)) > 1 else (path,)


def stands_for_all(path: Path) -> bool:
    """Return whether a file is the first of its recording, which stands for the others."""
    return path == next(filter(is_file, axis_files(path)), path)


def axes_first(samples: Array) -> Array | None:
    """Transpose (samples,), (axes, samples) or (samples, axes) to (axes, samples), 1 to 64 axes.

    Returns:
        None if the samples have another shape or there are none.
    """
    trace = samples[None] if samples.ndim == 1 else samples
    if trace.ndim != 2 or not trace.size or min(trace.shape) > MAX_AXES:
        return None
    return trace if trace.shape[0] <= trace.shape[1] else trace.T


def choose_channels(trace: Array, channels: Sequence[int] | None, name: str) -> Array:
    """Select the numbered axes of samples (axes, samples), counted from 0; None keeps all.

    Raises:
        UserError: If there are not so many, beginning with ``name``.
    """
    if channels is None:
        return trace
    if (last := max(channels)) >= len(trace):
        raise UserError(
            f"{name} has {len(trace)} channels, and data.channels names {last}, counted from 0; "
            "choose others."
        )
    return trace[list(channels)]


def _read_file(path: Path) -> Table:
    require_file(path)
    if (read := READERS.get(path.suffix.lower())) is None:
        raise UserError(f"Trace {path} has an unknown type; use {', '.join(TRACE_SUFFIXES)}.")
    try:
        table, rate = read(path)
    except DAMAGE as error:
        raise UserError(
            f"Trace {path} cannot be read ({reason(error)}); correct or replace the file."
        ) from error
    if (trace := axes_first(table)) is None:
        raise UserError(
            f"Trace {path} has the shape {table.shape}; a trace has samples of 1 to {MAX_AXES} "
            "channels."
        )
    return trace, rate


def _read_sound(path: Path) -> Table:
    with soundfile.SoundFile(path) as sound:  # which reads a truncated file without a word
        if cut := CUT.search(sound.extra_info):
            length, rest = int(cut[1]), int(cut[2])
            if rest < length < UNKNOWN_LENGTH:
                raise ValueError(f"truncated: {length - rest} of {length} bytes are missing")
        _check_count(sound.frames * sound.channels)  # a small FLAC file may hold hours of silence
        samples = sound.read(dtype="float32", always_2d=True)
        return samples, float(sound.samplerate)


def _check_count(count: int) -> None:
    if count > MAX_SAMPLES:
        raise ValueError(f"it claims {count:,} samples, and {MAX_SAMPLES:,} are the most")


def _read_array(path: Path) -> Table:
    try:
        with suppress_warnings():  # a map takes no memory for what a header claims
            array = np.load(path, mmap_mode="r", allow_pickle=False)
    except OSError:
        raise
    except Exception as error:  # of any kind; the words of some propose to load it unsafely
        raise ValueError("it is no whole array of numbers as np.save writes it") from error
    if not isinstance(array, np.ndarray):
        raise ValueError("it is an .npz archive; save one array with np.save")
    if array.dtype.kind not in "fiu":
        raise ValueError(f"it holds {array.dtype} instead of numbers")
    _check_count(array.size)
    return np.array(array, np.float64), None


def _read_text(path: Path) -> Table:
    """Read the columns of a text file and take its column of time out of them."""
    if (size := path.stat().st_size) > MAX_TEXT:
        raise ValueError(f"it is {size:,} bytes of text, more than {MAX_TEXT:,}; save it as WAV")
    check_lines(path)
    text = path.read_bytes().decode("utf-8-sig", errors="replace").replace('"', "")
    lines = [line for raw in text.splitlines() if (line := raw.strip().rstrip(";,\t "))]
    start = next((number for number, line in enumerate(lines) if _is_numbers(line)), len(lines))
    data = [line for line in lines[start:] if line[0] not in MARKS]
    if not data:
        raise ValueError("no numbers")
    delimiter = next((mark for mark in DELIMITERS if mark in data[0]), None)
    if delimiter != ",":
        data = [line.replace(",", ".") for line in data]  # decimal commas
    table = np.loadtxt(data, delimiter=delimiter, ndmin=2)
    names = [_cells(line.lstrip(f"{MARKS} \t")) for line in lines[:start]]
    time = _find_time([row for row in names if len(row) == table.shape[1]], table)
    if time is not None:
        return _even_samples(path, table[:, time[0]], np.delete(table, time[0], axis=1), time[1])
    if delimiter == "," and table.shape[1] == 2 and not names and "." not in "".join(data):
        raise ValueError(
            "it has decimal commas or two columns of whole numbers: write decimal points, or a "
            "line of names"
        )
    return table, None


def _is_numbers(line: str) -> bool:
    try:
        [float(field) for field in re.split(r"[;,\s]+", line) if field]
    except ValueError:
        return False
    return True


def _cells(line: str) -> list[str]:
    return line.split(next((mark for mark in DELIMITERS if mark in line), None))


def _find_time(names: list[list[str]], table: Array) -> tuple[int, float] | None:
    """Find index and unit in seconds of the column of time."""
    for row in names:
        words = [re.findall(r"[^\W\d_]+", name.casefold()) for name in row]
        times = [index for index, name in enumerate(words) if name and name[0] in TIMES]
        if len(times) > 1:
            raise ValueError(f"it has {len(times)} columns of time; keep one")
        for index in times:
            unit = words[index][-1]
            if unit not in SECONDS:
                raise ValueError(
                    f"its column {shorten(repr(row[index]))} has an unknown unit; call it time_s, "
                    "time_ms or time_us"
                )
            return index, SECONDS[unit]
    rises = len(table) >= MIN_RISING and bool((np.diff(table[:, 0]) > 0).all())
    return (0, 1.0) if rises and table.shape[1] > 1 else None


def _even_samples(path: Path, times: Array, samples: Array, unit: float) -> Table:
    """Interpolate samples (samples, axes) at even steps, and return them as (axes, samples).

    The step is the mean of all that are no gaps: times are often rounded to few digits, so that
    their median is none.

    Raises:
        ValueError: If the times do not rise, or most samples are missing.
    """
    steps = np.diff(times)
    if not len(steps) or not (steps > 0).all():
        raise ValueError(f"its times do not rise at sample {np.argmin([*(steps > 0), False]) + 1}")
    gaps = steps > MISSING * np.median(steps)
    step = float(steps[~gaps].mean())
    count = round(float(times[-1] - times[0]) / step) + 1
    if count > MAX_FILLED * len(times):
        raise ValueError(
            f"its times have gaps of up to {steps.max() / step:,.0f} steps, so that most samples "
            "are missing"
        )
    if steps.max() > LARGE_GAP * step:
        log.warning(
            "Trace %s has gaps in its column of time, the largest of %.3g s after sample %d; they "
            "are filled with straight lines.", path, steps.max() * unit, steps.argmax(),
        )  # fmt: skip
    axes = samples.T
    if (np.abs(steps - step) > EVEN * step).any():
        grid = times[0] + np.arange(count) * step
        axes = np.stack([np.interp(grid, times, axis) for axis in axes])
    return axes, 1 / (step * unit)


READERS: dict[str, Callable[[Path], Table]] = {
    **dict.fromkeys((".wav", ".flac"), _read_sound),
    ".npy": _read_array,
    ".txt": _read_text,
    ".csv": _read_text,
}
TRACE_SUFFIXES = tuple(READERS)
