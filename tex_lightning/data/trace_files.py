"""Samples of a trace as they stand in its file, or in three with an axis each."""

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt
import soundfile

from tex_lightning.errors import UserError
from tex_lightning.files import require_file

TRACE_SUFFIXES = (".wav", ".npy", ".txt", ".csv")
UNKNOWN_LENGTH = 0x7FFF0000  # programs that stream write such a length for want of a better one


def axis_files(path: Path) -> tuple[Path, ...]:
    """The files of one recording: three if its axes lie apart, as in LMT-108, else the file alone.

    Files are axes of one recording if their names differ in ``_X_``, ``_Y_``, ``_Z_`` before the
    last part of the name (``G1Mesh_Movement_X_train1.txt``). Any of the three stands for all.

    Raises:
        UserError: If two of the three are there.
    """
    match = re.fullmatch(r"(.+_)[XYZ](_[^_]+)", path.name)
    if match is None or path.suffix.lower() not in TRACE_SUFFIXES:
        return (path,)
    files = tuple(path.with_name(f"{match[1]}{axis}{match[2]}") for axis in "XYZ")
    missing = [file for file in files if not file.is_file()]
    if len(missing) == 1:
        raise UserError(
            f"Trace {path} is one axis of three, but {missing[0]} does not exist; add it "
            "or, if it is no axis, rename the file."
        )
    return (path,) if missing else files


def read_axes(path: Path) -> tuple[npt.NDArray[np.floating], float | None]:
    """Samples (axes, samples) out of one file or three, and the rate if the file carries one.

    Raises:
        UserError: If a file is missing, empty, damaged or of another shape.
    """
    axes = []
    for file in (files := axis_files(path)):
        require_file(file)
        samples, rate = _read_samples(file)
        axes.append(_as_axes(file, samples))
    if len(files) > 1 and {axis.shape for axis in axes} != {(1, axes[0].shape[1])}:
        shapes = ", ".join(f"{len(axis)} x {axis.shape[1]}" for axis in axes)
        raise UserError(
            f"The axes X, Y, Z of trace {path} have {shapes} samples; they must be single and of "
            "one length."
        )
    return np.concatenate(axes), rate


def _read_samples(path: Path) -> tuple[npt.NDArray[np.floating], float | None]:
    """Samples as (samples,) or 2-D, and the rate if the file carries one."""
    suffix = path.suffix.lower()
    try:
        if suffix == ".wav":
            _check_wav_length(path)
            samples, rate = soundfile.read(path, dtype="float32", always_2d=True)
            return samples, float(rate)
        if suffix == ".npy":
            array = np.load(path, allow_pickle=False)
            if not isinstance(array, np.ndarray):
                raise ValueError("it is an .npz archive; save one array with np.save")
            return _numeric(array), None
        if suffix in (".txt", ".csv"):
            return _read_text(path), None
    except (soundfile.SoundFileError, ValueError, EOFError, OSError) as error:
        raise UserError(f"Trace {path} cannot be read ({error}); replace the file.") from error
    raise UserError(f"Trace {path} has an unknown type; use {', '.join(TRACE_SUFFIXES)}.")


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


def _numeric(array: npt.NDArray[np.generic]) -> npt.NDArray[np.floating]:
    if array.dtype.kind not in "fiu":
        raise ValueError(f"it holds {array.dtype} instead of numbers")
    return array.astype(np.float64)


def _read_text(path: Path) -> npt.NDArray[np.floating]:
    """One sample a line; columns apart by comma, semicolon or white space; header optional."""
    with path.open(encoding="utf-8-sig") as stream:
        first = stream.readline()
    delimiter = next((mark for mark in ",;" if mark in first), None)
    fields = [field.strip() for field in first.split(delimiter)]
    skip = int(not all(_is_number(field) for field in fields if field))
    with path.open(encoding="utf-8-sig") as stream:
        lines = [line for line in stream if line.strip()][skip:]
    if not lines:
        raise ValueError("no numbers")
    return np.loadtxt(lines, delimiter=delimiter, ndmin=1)


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def _as_axes(path: Path, samples: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Bring samples to (axes, samples)."""
    trace = samples[None] if samples.ndim == 1 else samples
    if trace.ndim == 2 and trace.shape[0] not in (1, 3):
        trace = trace.T
    if trace.ndim != 2 or trace.shape[0] not in (1, 3):
        raise UserError(
            f"Trace {path} has shape {samples.shape}; a trace has one or three axes (columns)."
        )
    if trace.shape[1] == 0:
        raise UserError(f"Trace {path} holds no samples; record or copy it again.")
    return trace
