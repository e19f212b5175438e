"""Recordings out of files and arrays; what is damaged, or only tex_lightning reads, is refused."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from tex_lightning_runtime.errors import UserError, require
from tex_lightning_runtime.resampling import Array

TRACES = (".wav", ".flac", ".npy", ".txt", ".csv")
PHOTOS = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
LARGEST = 1e9  # no unit of acceleration comes near; squares still fit float32
NUMBERS = re.compile(r"[-+.,;\s\deE]*\d[-+.,;\s\deE]*")
TIME = re.compile(r"(^|[,;#%\s])(time\w*|t|zeit|m?secs?|m?seconds?)([\W_]|$)", re.IGNORECASE)
EVEN = 8  # fewer numbers may rise by chance


def read_trace(path: Path, channel: int | None, rate: float | None) -> tuple[Array, float | None]:
    """Read samples (axes, samples) and their rate in Hz: the file's, else ``rate``."""
    _check(path)
    suffix, own = path.suffix.lower(), None
    require(suffix in TRACES, f"Trace {path} has an unknown type; use {', '.join(TRACES)}.")
    try:
        if suffix in (".wav", ".flac"):
            table, own = _read_sound(path)
        else:
            table = _read_text(path) if suffix != ".npy" else np.load(path, allow_pickle=False)
    except (RuntimeError, ValueError, EOFError, OSError) as error:
        raise UserError(f"Trace {path} cannot be read ({error}); replace the file.") from error
    tables = [folder / "rates.csv" for folder in path.absolute().parents[:3]]
    for other in (path.with_name(f"{path.name}.json"), path.with_suffix(".json"), *tables):
        said = f"{other} may say the rate of {path}, but is not read; give rate=HZ."
        require(own or rate or not other.is_file(), said)
    if channel is not None and table.ndim == 2:
        table = table.T if len(table) < table.shape[1] else table
        table = table[:, channel : channel + 1]  # nothing if there is none, which is refused
    return as_trace(table, f"Trace {path}", np.float32 if own else np.float64), own or rate


def as_trace(given: Any, name: str, dtype: type = np.float64) -> Array:
    """Samples (axes, samples) of (samples,), (axes, samples) or (samples, axes)."""
    array = _as_array(given, name)
    trace = array[None] if array.ndim == 1 else array
    trace = trace.T if trace.ndim == 2 and len(trace) not in (1, 3) else trace
    fits = array.dtype.kind in "fiu" and trace.ndim == 2 and len(trace) in (1, 3) and trace.size
    require(fits, f"{name} is {array.dtype} {array.shape}; give numbers, one axis or three.")
    usable = (np.abs(trace) < LARGEST).all(axis=0)  # false for NaN
    said = f"{name} holds NaN, infinity or a number beyond {LARGEST:g} at sample "
    require(usable.all(), f"{said}{usable.argmin()}; repair the recording.")
    return trace.astype(dtype)


def read_photo(path: Path) -> Array:
    """Read RGB pixels (height, width, 3) uint8, upright."""
    from PIL import Image, ImageOps  # where it is needed: start-up is counted in milliseconds

    _check(path)
    try:
        with Image.open(path) as image:
            deep = image.mode.startswith(("I", "F"))
            require(not deep, f"Image {path} has {image.mode} pixels; save it with 8 bits.")
            ImageOps.exif_transpose(image, in_place=True)
            return np.array(image if image.mode == "RGB" else image.convert("RGB"))
    except (Image.DecompressionBombError, OSError, SyntaxError, ValueError) as error:
        raise UserError(f"Image {path} cannot be read ({error}); replace the file.") from error


def as_photo(given: Any, name: str) -> Array:
    """Pixels (height, width, 3) of such or of greys (height, width), uint8."""
    array = _as_array(given, name)
    photo = np.repeat(array[..., None], 3, axis=2) if array.ndim == 2 else array
    fits = photo.dtype == np.uint8 and photo.ndim == 3 and photo.shape[2] == 3 and photo.size
    require(fits, f"{name} is {array.dtype} {array.shape}; give uint8 (height, width, 3).")
    return np.ascontiguousarray(photo)


def _as_array(given: Any, name: str) -> Array:
    try:
        return np.asarray(given)
    except ValueError as error:  # of lists of unequal lengths
        raise UserError(f"{name} cannot be read as an array ({error}); give one.") from error


def _check(path: Path) -> None:
    require(path.is_file() and path.stat().st_size, f"File {path} does not exist or is empty.")
    axes = re.fullmatch(r"(.+_)[XYZ](_[^_]+)", path.name)
    there = [path.with_name(each.join(axes.groups())).is_file() for each in "XYZ"] if axes else []
    require(sum(there) < 2, f"{path} is one axis of several files; make them columns of one.")


def _read_sound(path: Path) -> tuple[Array, float]:
    import soundfile

    with path.open("rb") as stream:  # libsndfile reads a truncated file without a word
        head = stream.read(2**16)
    place = head.find(b"data") + 8 if head.startswith(b"RIFF") else 0
    length = int.from_bytes(head[place - 4 : place], "little") if place > 7 else 0
    if path.stat().st_size - place < length < 0x7FFF0000:  # which programs write that stream
        raise ValueError("truncated")
    samples, rate = soundfile.read(path, dtype="float32", always_2d=True)
    return samples, float(rate)


def _read_text(path: Path) -> Array:
    """One sample a line, columns apart by comma, semicolon or white space, perhaps with names."""
    text = path.read_text("utf-8-sig", "replace").replace('"', "")
    lines = [line for raw in text.splitlines() if (line := raw.strip().rstrip(";,\t "))]
    first = next((n for n, line in enumerate(lines) if NUMBERS.fullmatch(line)), len(lines))
    data = [line for line in lines[first:] if line[0] not in "#%"] or ["no numbers"]
    mark = ";" if ";" in data[0] else "," if "," in data[0] else None
    table = np.loadtxt(data, delimiter=mark, ndmin=2)  # refuses decimal commas
    rising = len(table) >= EVEN and bool((np.diff(table[:, 0]) > 0).all())
    if table.shape[1] > 1 and (rising or any(map(TIME.search, lines[:first]))):
        raise ValueError("it has a column of time; delete it, and give rate=HZ")
    return table[:, 0] if table.shape[1] == 1 else table
