"""Samples of a trace as they stand in its file, or in three with an axis each."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import soundfile

from tex_lightning.core.files import check_lines, is_file, require_file
from tex_lightning.core.quiet import quietly
from tex_lightning.data.text_traces import read_text_trace
from tex_lightning.data.time_column import RawTrace, choose_channel
from tex_lightning.data.xml_traces import read_xml_trace
from tex_lightning.errors import UserError, reason

SOUND_SUFFIXES = (".wav", ".flac")  # what libsndfile decodes
TRACE_SUFFIXES = (*SOUND_SUFFIXES, ".npy", ".txt", ".csv", ".xml")
RATE_TOLERANCE = 0.01
MOST_SAMPLES = 1 << 29  # of a file, 2 GiB of float32: 14 h of one axis at 10 kHz
LARGEST_TEXT = 1 << 29  # bytes
DAMAGE = (soundfile.SoundFileError, ValueError, EOFError, OSError, LookupError, MemoryError)
UNKNOWN_LENGTH = 0x7FFF0000  # programs that stream write such a length for want of a better one


def axis_paths(path: Path) -> tuple[Path, ...]:
    """The files of one recording that are there, in the order of their axes.

    Files are axes of one recording if their names differ in ``_X_``, ``_Y_``, ``_Z_`` before the
    last part of the name (``G1Mesh_Movement_X_train1.txt``). Any of the three stands for all.
    """
    found = tuple(file for file in _axis_names(path) if is_file(file))
    return found if len(found) > 1 else (path,)


def axis_files(path: Path) -> tuple[Path, ...]:
    """The files of one recording: three if its axes lie apart, as in LMT-108, else the file alone.

    Raises:
        UserError: If two of the three are there.
    """
    files = axis_paths(path)
    if len(files) == 2:
        (missing,) = set(_axis_names(path)) - set(files)
        raise UserError(
            f"Trace {path} is one axis of three, but {missing} does not exist; add it "
            "or, if it is no axis, rename the file."
        )
    return files


def _axis_names(path: Path) -> tuple[Path, ...]:
    match = re.fullmatch(r"(.+_)[XYZ](_[^_]+)", path.name)
    if match is None or path.suffix.lower() not in TRACE_SUFFIXES:
        return (path,)
    return tuple(path.with_name(f"{match[1]}{axis}{match[2]}") for axis in "XYZ")


def read_axes(path: Path, channel: int | None = None) -> RawTrace:
    """Read the samples out of one file or three; of a file only one channel if that is given.

    Raises:
        UserError: If a file is missing, empty, damaged or of another shape, or its column of time
            cannot be used.
    """
    axes = []
    for file in axis_files(path):
        require_file(file)
        axes.append(_read_file(file, channel))
    if len(axes) == 1:
        return axes[0]
    if {axis.samples.shape for axis in axes} != {(1, axes[0].samples.shape[1])}:
        shapes = ", ".join(" x ".join(map(str, axis.samples.shape)) for axis in axes)
        raise UserError(
            f"The axes X, Y, Z of trace {path} have {shapes} samples; they must be single and of "
            "one length."
        )
    rates = [axis.rate or 0.0 for axis in axes]
    if not all(same_rate(rate, rates[0]) for rate in rates):
        told = ", ".join(f"{rate:,.6g} Hz" if rate else "none" for rate in rates)
        raise UserError(f"The axes X, Y, Z of trace {path} have the rates {told}; make them equal.")
    samples = np.concatenate([axis.samples for axis in axes])
    return replace(axes[0], samples=samples, interpolated=any(axis.interpolated for axis in axes))


def same_rate(one: float, other: float) -> bool:
    """Whether two rates in Hz may be told of one file; a column of time is never exact."""
    return math.isclose(one, other, rel_tol=RATE_TOLERANCE)


def _read_file(path: Path, channel: int | None) -> RawTrace:
    suffix = path.suffix.lower()
    try:
        if suffix in SOUND_SUFFIXES:
            _check_wav_length(path)
            _check_samples(path)
            samples, rate = soundfile.read(path, dtype="float32", always_2d=True)
            samples = choose_channel(path, samples, channel)
            if samples.shape[1] == 2:
                raise UserError(
                    f"Trace {path} has two channels, but a trace has one or three axes; choose one "
                    "by +model.SENSE.decode.channel=0, or save it with one."
                )
            return RawTrace(_as_axes(path, samples), float(rate))
        if suffix == ".npy":
            array = _read_array(path)
            return RawTrace(_as_axes(path, _chosen(path, array, channel)))
        if suffix in (".txt", ".csv"):
            _check_text(path)
            text = read_text_trace(path, channel)
            return replace(text, samples=_as_axes(path, text.samples))
        if suffix == ".xml":
            _check_text(path)
            trace = read_xml_trace(path)
            return replace(trace, samples=_chosen(path, trace.samples, channel))
    except DAMAGE as error:
        raise UserError(
            f"Trace {path} cannot be read ({reason(error)}); replace the file."
        ) from error
    raise UserError(f"Trace {path} has an unknown type; use {', '.join(TRACE_SUFFIXES)}.")


def _chosen(
    path: Path, array: npt.NDArray[np.floating], channel: int | None
) -> npt.NDArray[np.floating]:
    """The channel of an array in either order, which has more samples than channels."""
    if channel is None or array.ndim != 2:
        return array
    return choose_channel(path, array.T if array.shape[0] < array.shape[1] else array, channel).T


def _read_array(path: Path) -> npt.NDArray[np.float64]:
    try:
        with quietly():
            # a map takes no memory for what a header claims
            array = np.load(path, mmap_mode="r", allow_pickle=False)
    except OSError:
        raise
    except Exception as error:  # of any kind; the words of some propose to load it unsafely
        raise ValueError("it is no whole array of numbers as np.save writes it") from error
    if not isinstance(array, np.ndarray):
        raise ValueError("it is an .npz archive; save one array with np.save")
    if array.dtype.kind not in "fiu":
        raise ValueError(f"it holds {array.dtype} instead of numbers")
    if array.size > MOST_SAMPLES:
        raise ValueError(f"it has {array.size:,} samples, and {MOST_SAMPLES:,} are the most")
    return np.array(array, np.float64)


def _check_wav_length(path: Path) -> None:
    """Compare sizes with the header: libsndfile reads a truncated file without a word."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        if stream.read(4) != b"RIFF":
            return
        stream.seek(12)
        while len(header := stream.read(8)) == 8:
            length = int.from_bytes(header[4:], "little")
            if header[:4] == b"data":
                missing = stream.tell() + length - size
                if missing > 0 and length < UNKNOWN_LENGTH:
                    raise ValueError(f"truncated: {missing} of {length} bytes are missing")
                return
            stream.seek(length + length % 2, 1)


def _check_samples(path: Path) -> None:
    """Refuse more samples than anyone records: a small FLAC file may hold hours of silence."""
    with soundfile.SoundFile(path) as sound:
        count = sound.frames * sound.channels
    if count > MOST_SAMPLES:
        raise ValueError(f"its header claims {count:,} samples, and {MOST_SAMPLES:,} are the most")


def _check_text(path: Path) -> None:
    """Refuse text that would not fit into memory as numbers."""
    if (size := path.stat().st_size) > LARGEST_TEXT:
        raise ValueError(
            f"it is {size / 2**20:,.0f} MiB of text, and {LARGEST_TEXT >> 20} are the most: save "
            "it as WAV or .npy, or in parts"
        )
    if path.suffix.lower() != ".xml":  # which may be a single line
        check_lines(path)


def _as_axes(path: Path, samples: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Bring samples of a file to (axes, samples)."""
    trace = axes_first(samples)
    if trace is None:
        raise UserError(
            f"Trace {path} has shape {samples.shape}; a trace has one or three axes (columns), "
            "and a column of time beside them must be called time."
        )
    if trace.shape[1] == 0:
        raise UserError(f"Trace {path} holds no samples; record or copy it again.")
    return trace


def axes_first(samples: npt.NDArray[np.floating]) -> npt.NDArray[np.floating] | None:
    """Bring (samples,), (axes, samples) or (samples, axes) to (axes, samples), one or three axes.

    Returns:
        None if the samples have another shape.
    """
    trace = samples[None] if samples.ndim == 1 else samples
    if trace.ndim == 2 and trace.shape[0] not in (1, 3):
        trace = trace.T
    return trace if trace.ndim == 2 and trace.shape[0] in (1, 3) else None
