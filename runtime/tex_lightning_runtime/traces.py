"""Signals out of files: samples (axes, samples) as they stand there, and their rate.

A signal has 1 to 64 axes; whatever the file, the longer dimension of its samples is time.

Sounds and NumPy arrays are read by their libraries, text by :mod:`.tables`.
"""

import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import NamedTuple

import numpy as np

from tex_lightning_runtime.archives import ARCHIVES, one_recording, read_archive, signals_of
from tex_lightning_runtime.column import SEEN, rising
from tex_lightning_runtime.columns import Reading, unlike_axes
from tex_lightning_runtime.errors import UserError, reason
from tex_lightning_runtime.files import is_file, require_file
from tex_lightning_runtime.samples import (
    MAX_AXES,
    MAX_SAMPLES,
    Array,
    Channels,
    axes_first,
    choose_channels,
)
from tex_lightning_runtime.tables import HEADER, SUFFIXES, read_table, separate_arrays
from tex_lightning_runtime.times import TableError

DAMAGE = (ValueError, EOFError, OSError, LookupError, MemoryError)
AXIS = re.compile(
    r"(|.*[_. -]|.*[a-z](?=[XYZ])|(?:.*[_. -])?(?:[A-Za-z]|acc|gyro?|mag|force|torque)(?=[xyz]))"
    r"([XYZxyz])((?:[_. -][^_. -]+)?\.\w+)"
)
SOUNDS = (".wav", ".flac")
NUMPY = b"\x93NUMPY"  # with which an array begins
_HEADERS = Lock()  # Python 3.11 parses one in two threads at once with a SystemError
# Samples in any order, or (axes, samples) by name; their rate in Hz if the file states it; notes.
Raw = tuple[Array | dict[str, Array], float | None, tuple[str, ...]]


class Signal(NamedTuple):
    """Samples in the order of the file, its rate in Hz if it states one, and how it was read."""

    samples: Array
    rate: float | None
    reading: Reading


def read_samples(path: Path, channels: Channels = None, time_unit: str | None = None) -> Signal:
    """Read the samples (axes, samples) out of one file, or three with an axis each.

    Args:
        path: The file, or any of the three (:func:`axis_files`).
        channels: Which of the axes are kept, as :func:`choose_channels` takes them.
        time_unit: Unit of times in a table; None takes what the table says.

    Returns:
        Samples of 1 to 64 axes, and their rate in Hz; None if the file does not state it.

    Raises:
        UserError: If a file is missing, empty, damaged or of another shape, or it is not clear
            what it means.
    """
    files = axis_files(path)
    if len(files) == 1:
        return _read_file(path, channels, time_unit)
    joined = _join_axes(path, [_read_file(file, None, time_unit) for file in files])
    return joined._replace(samples=choose_channels(joined.samples, channels, f"Trace {path}"))


def _join_axes(path: Path, parts: list[Signal]) -> Signal:
    shapes = [part.samples.shape for part in parts]
    if {*shapes} != {(1, shapes[0][1])} or len({part.rate for part in parts}) > 1:
        raise UserError(
            f"The axes X, Y, Z of trace {path} have the shapes {', '.join(map(str, shapes))}; each "
            "must be a single one, and all of one length and rate; call recordings of their own "
            "otherwise."
        )
    names = tuple(name for part in parts for name in part.reading.axes)
    reading = replace(parts[0].reading, axes=names)
    return Signal(np.concatenate([part.samples for part in parts]), parts[0].rate, reading)


def axis_files(path: Path) -> tuple[Path, ...]:
    """List the files of one recording: three if its axes lie apart, as in LMT-108, else itself.

    Files are axes of one recording if their names differ in ``X``, ``Y``, ``Z`` at their end or
    before the last part (``G1Mesh_Movement_X_train1.txt``, ``1_x.csv``, ``1_ax.csv``).
    Any of them stands for all. X and Y may be alone; else all are needed if there are two.
    """
    match = AXIS.fullmatch(path.name)
    if match is None or path.suffix.lower() not in TRACE_SUFFIXES:
        return (path,)
    names = "XYZ" if match[2].isupper() else "xyz"
    files = tuple(path.with_name(f"{match[1]}{axis}{match[3]}") for axis in names)
    there = [*map(is_file, files)]
    return (path,) if sum(there) < 2 else files if there[2] else files[:2]


def stands_for_all(path: Path) -> bool:
    """Return whether a file is the first of its recording, which stands for the others."""
    return path == next(filter(is_file, axis_files(path)), path)


def _read_file(path: Path, channels: Channels, time_unit: str | None) -> Signal:
    require_file(path)
    try:
        table, rate, reading = _read_any(path, channels, time_unit)
    except TableError as error:
        raise UserError(f"Trace {path} {reason(error)}.") from error
    except DAMAGE as error:
        raise UserError(
            f"Trace {path} cannot be read ({reason(error)}); correct or replace the file."
        ) from error
    named = bool(reading.axes)  # which says what the columns are
    trace = table if named or path.suffix.lower() in SOUNDS else axes_first(table)
    if trace is None or not 0 < table.size <= MAX_SAMPLES or len(trace) > MAX_AXES:
        raise UserError(
            f"Trace {path} has the shape {table.shape}; a trace has samples of 1 to {MAX_AXES} "
            "channels: give a file of one recording that is not empty."
        )
    if named or path.suffix.lower() in SUFFIXES:
        return Signal(trace, rate, reading)
    trace = choose_channels(trace, channels, f"Trace {path}")
    told = unlike_axes(trace) if channels is None else []
    if any(rising(axis[:SEEN]) for axis in trace):
        told.insert(0, "an axis rises evenly; if it is time, choose the others by data.channels")
    notes = ("; ".join(told),) if told else ()
    return Signal(trace, rate, replace(reading, notes=(*reading.notes, *notes)))


def _read_any(path: Path, channels: Channels, time_unit: str | None) -> Signal:
    """Read the samples of a file by its type, in whatever order it has them."""
    suffix = path.suffix.lower()
    if suffix in SUFFIXES:
        return Signal(*read_table(path, channels, time_unit))
    if suffix not in READERS:
        raise UserError(f"Trace {path} has an unknown type; use {', '.join(TRACE_SUFFIXES)}.")
    with warnings.catch_warnings(action="ignore"):
        found, rate, notes = READERS[suffix](path)
    if isinstance(found, dict):
        return Signal(*separate_arrays(found, channels, time_unit, rate))
    return Signal(found, rate, Reading(rate_from=HEADER if rate else "", notes=notes))


def _read_sound(path: Path) -> Raw:
    from tex_lightning_runtime.sounds import read_sound  # where it is needed: it loads a library

    samples, rate, notes = read_sound(path, MAX_SAMPLES)
    return samples.T, rate, tuple(notes)


def map_array(path: Path) -> Array:
    """Map an array as ``numpy.save`` writes it, without pickles; threads do it one at a time."""
    with _HEADERS:
        array: Array = np.load(path, mmap_mode="r", allow_pickle=False)
    return array


def _read_array(path: Path) -> Raw:
    try:
        array = map_array(path)  # which takes no memory for what a header claims
    except OSError:
        raise
    except Exception as error:  # of any kind; the words of some propose to load it unsafely
        if "objects" in str(error):
            raise ValueError(
                "it holds objects of Python, such as a dict, which may run code; save the samples "
                "alone by np.save, or by np.savez(FILE, x=SAMPLES, fs=RATE)"
            ) from None
        raise ValueError("it is no whole array of numbers as np.save writes it") from error
    if not isinstance(array, np.ndarray):
        raise ValueError("it is an .npz archive; call it .npz")
    with path.open("rb") as stream:
        stream.seek(getattr(array, "offset", 0) + array.nbytes)
        if stream.read(len(NUMPY)) == NUMPY:
            raise ValueError("it holds several arrays; save each into a file of its own")
    if array.dtype.names and array.size <= MAX_SAMPLES:
        return _signals(*signals_of({"": array}))
    if array.dtype.kind not in "fiu":
        raise ValueError(f"it holds {array.dtype} instead of numbers")
    if array.size > MAX_SAMPLES:
        raise ValueError(f"it claims {array.size:,} samples, and {MAX_SAMPLES:,} are the most")
    return np.array(one_recording(array), np.float64), None, ()


def _signals(arrays: dict[str, Array], rate: float | None) -> Raw:
    only = np.asarray(next(iter(arrays.values())), np.float64)
    return arrays if len(arrays) > 1 else only, rate, ()


READERS: dict[str, Callable[[Path], Raw]] = {
    **dict.fromkeys(SOUNDS, _read_sound),
    ".npy": _read_array,
    **dict.fromkeys(ARCHIVES, lambda path: _signals(*read_archive(path, MAX_SAMPLES))),
}
TRACE_SUFFIXES = (*READERS, *SUFFIXES)
