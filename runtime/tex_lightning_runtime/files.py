"""Recordings out of files and arrays; what is damaged, or only tex_lightning reads, is refused."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
TRACES = (".wav", ".flac", ".npy", ".txt", ".csv")
PHOTOS = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
FORMATS = ("JPEG", "PNG", "BMP", "TIFF", "WEBP")  # that Pillow may try
LARGEST = 1e9  # no unit of acceleration comes near; squares still fit float32
NUMBERS = re.compile(r"[-+.,;\s\deE]*\d[-+.,;\s\deE]*")
TIME = re.compile(r"(^|[,;#%\s])(time\w*|t|zeit|m?secs?|m?seconds?)([\W_]|$)", re.IGNORECASE)
EVEN = 8  # fewer numbers may rise by chance
CUT = re.compile(r"data : (\d+) \(should be (\d+)\)")  # libsndfile's note of a truncated file
STREAMED = 0x7FFF0000  # bytes, and more, are announced by who does not know how many will come


class UserError(Exception):
    """Bad input: one plain sentence of what was wrong, where, and what to do."""


def require(condition: object, message: str) -> None:
    """Raise a :class:`UserError` unless the condition holds."""
    if not condition:
        raise UserError(message)


def read_trace(given: Any, sense: dict[str, Any], rate: float | None) -> tuple[Array, float]:
    """Samples (axes, samples) and their rate in Hz: that of the file, ``rate``, or the card's."""
    name, own, usual = sense["modality"], None, sense["rate"]
    table = _read(_read_table, given, name)
    if isinstance(table, tuple):
        (table, own), name, usual = table, f"Trace {given}", sense["file_rate"]
        if (channel := sense["channel"]) is not None and table.ndim == 2:
            table = table.T if len(table) < table.shape[1] else table
            table = table[:, channel : channel + 1]  # nothing if there is none, which is refused
        stated = "" if own or rate else _stated(Path(given).expanduser())
        require(not stated, f"{stated} may say the rate of {given}, but is not read; give rate=HZ.")
    trace = np.atleast_2d(table)
    trace = trace if len(trace) in (1, 3) else trace.T
    fits = table.dtype.kind in "fiu" and table.ndim in (1, 2) and len(trace) in (1, 3)
    said = f"{name} is {table.dtype} {table.shape}; give numbers, one axis or three."
    require(fits and trace.size, said)
    usable = (np.abs(trace) < LARGEST).all(axis=0)  # false for NaN
    said = f"{name} holds NaN, infinity or a number beyond {LARGEST:g} at sample "
    require(usable.all(), f"{said}{usable.argmin()}; repair the recording.")
    return trace.astype(np.float32 if own else np.float64), own or (usual if rate is None else rate)


def read_photo(given: Any, name: str) -> Array:
    """Pixels (height, width, 3) uint8, RGB, upright, also of greys (height, width)."""
    array: Array = _read(_read_pixels, given, name)
    photo = np.repeat(array[..., None], 3, axis=2) if array.ndim == 2 else array
    fits = photo.dtype == np.uint8 and photo.ndim == 3 and photo.shape[2] == 3 and photo.size
    require(fits, f"{name} is {array.dtype} {array.shape}; give uint8 (height, width, 3).")
    return np.ascontiguousarray(photo)


def _read(read: Callable[[Path], Any], given: Any, name: str) -> Any:
    """What ``read`` makes of a file, or an array as it is."""
    file = Path(given).expanduser() if isinstance(given, str | Path) else None
    there = not file or (file.is_file() and file.stat().st_size)
    require(there, f"File {given} does not exist or is empty; correct the name.")
    try:
        return read(file) if file else np.asarray(given)
    except Exception as error:  # libraries raise in as many ways as there are formats
        raise UserError(
            f"{file or name} cannot be read ({error}); repair or replace it."
        ) from error


def _read_table(path: Path) -> tuple[Array, float | None]:
    """Columns of a file, and of sounds their rate in Hz."""
    axes, suffix = re.fullmatch(r"(.+_)[XYZ](_[^_]+)", path.name), path.suffix.lower()
    if axes and sum(path.with_name(each.join(axes.groups())).is_file() for each in "XYZ") > 1:
        raise ValueError("it is one axis of several files, make them columns of one")
    if suffix not in TRACES:
        raise ValueError(f"it is of an unknown type, use {', '.join(TRACES)}")
    if suffix == ".npy":
        return np.lib.format.open_memmap(path, "r"), None
    if suffix in (".txt", ".csv"):
        return _read_text(path.read_text("utf-8-sig", "replace").replace('"', "")), None
    import soundfile  # where it is needed: start-up is counted in milliseconds

    with soundfile.SoundFile(path) as sound:  # which reads a truncated file without an error
        cut = CUT.search(sound.extra_info)
        if cut and int(cut[2]) < int(cut[1]) < STREAMED:
            raise ValueError("it is truncated")
        return sound.read(dtype="float32", always_2d=True), float(sound.samplerate)


def _read_text(text: str) -> Array:
    """One sample a line, columns apart by comma, semicolon or white space, perhaps with names."""
    lines = [line for raw in text.splitlines() if (line := raw.strip().rstrip(";,\t "))]
    first = next((n for n, line in enumerate(lines) if NUMBERS.fullmatch(line)), len(lines))
    data = [line for line in lines[first:] if line[0] not in "#%"] or ["no numbers"]
    mark = ";" if ";" in data[0] else "," if "," in data[0] else None
    table = np.loadtxt(data, delimiter=mark, ndmin=2)  # refuses decimal commas
    rising = len(table) >= EVEN and bool((np.diff(table[:, 0]) > 0).all())
    if table.shape[1] > 1 and (rising or any(map(TIME.search, lines[:first]))):
        raise ValueError("it has a column of time, delete it and give rate=HZ")
    return table[:, 0] if table.shape[1] == 1 else table


def _stated(path: Path) -> str:
    """Where tex_lightning would look for the rate of a trace."""
    tables = [folder / "rates.csv" for folder in path.absolute().parents[:3]]
    beside = path.with_name(f"{path.name}.json"), path.with_suffix(".json")
    return " and ".join(str(each) for each in (*beside, *tables) if each.is_file())


def _read_pixels(path: Path) -> Array:
    from PIL import Image, ImageOps

    with Image.open(path, formats=FORMATS) as image:
        if image.mode.startswith(("I", "F")):
            raise ValueError(f"its pixels are {image.mode}, save it with 8 bits")
        ImageOps.exif_transpose(image, in_place=True)
        return np.array(image if image.mode == "RGB" else image.convert("RGB"))
