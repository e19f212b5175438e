"""Arrays in HDF5, as h5py writes it, and in MATLAB's ``.mat`` of version 7.3.

It is read by pyfive, in Python alone: the library of HDF5 is known to crash on damaged files.
"""

import math
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from tex_lightning_runtime.errors import reason
from tex_lightning_runtime.files import natural_key
from tex_lightning_runtime.samples import Array

SIGNATURE = b"\x89HDF\r\n\x1a\n"
STARTS = (0, 512, 1024, 2048)  # bytes: MATLAB writes a header of its own before it
BASE_OF_OLD, BASE_OF_NEW = 24, 12  # where versions 0 and 1, and later ones say where it begins
NO_NUMBERS = (b"char", b"logical", b"cell", b"function_handle")  # of MATLAB's classes
NUMBERS = "fiu"  # of NumPy's kinds of types
MAX_PARTS = 500  # takes about two seconds


class Hdf5Error(ValueError):
    """What is wrong with a file, in words that stand after its name."""


def is_hdf5(path: Path) -> bool:
    """Return whether a file begins as one of HDF5."""
    with path.open("rb") as file:
        return _start(file.read(STARTS[-1] + len(SIGNATURE))) is not None


def _start(data: bytes | bytearray) -> int | None:
    """Return where HDF5 begins, None if it does not."""
    return next((at for at in STARTS if data[at : at + len(SIGNATURE)] == SIGNATURE), None)


def _content(path: Path) -> BytesIO:
    """Return a file without what stands before HDF5 in it.

    pyfive counts that only in some places, does not see that a file is cut off, and leaves one that
    it cannot read open.

    Raises:
        Hdf5Error: If it is cut off, or something else.
    """
    data = bytearray(path.read_bytes())
    start = _start(data)
    if start is None:
        raise Hdf5Error("it is no HDF5")
    base = start + (BASE_OF_OLD if data[start + len(SIGNATURE)] < 2 else BASE_OF_NEW)
    if int.from_bytes(data[base + 16 : base + 24], "little") > len(data):
        raise Hdf5Error("it is cut off")
    data[base : base + 8] = bytes(8)
    return BytesIO(memoryview(data)[start:])


def read_hdf5(path: Path, most: int) -> dict[str, Array]:
    """Return arrays of numbers by their path (``trial/acc``), and attributes of one number or text.

    Truth values, other text and cells are left out.

    Raises:
        Hdf5Error: If pyfive is missing, the file is damaged or has what pyfive does not read, or
            it claims more than ``most`` numbers.
    """
    try:
        import pyfive
    except ImportError as error:
        raise Hdf5Error("reading HDF5 takes pyfive: pip install pyfive, or save .npy") from error
    if (size := path.stat().st_size) > 8 * most:
        raise Hdf5Error(f"it has {size:,} bytes; keep the signal alone")
    try:
        with pyfive.File(_content(path)) as file:
            numbers = dict(each for name, part in _parts(file) for each in _numbers(name, part))
            claimed = sum(math.prod(part.shape) for part in numbers.values())
            if claimed > most:
                raise Hdf5Error(f"it claims {claimed:,} numbers")
            return {name: np.asarray(part[...]) for name, part in numbers.items()}
    except Hdf5Error:
        raise
    except Exception as error:  # of any kind
        said = reason(error) or type(error).__name__
        raise Hdf5Error(
            f"it is damaged, or of a form that pyfive does not read ({said}); save it again with "
            "the usual settings of h5py or MATLAB, or as .npy"
        ) from error


def _parts(file: Any) -> Iterator[tuple[str, Any]]:
    """Yield all groups and datasets by their path, without what belongs to MATLAB's cells."""
    waiting = [("", file)]
    for _ in range(MAX_PARTS):
        if not waiting:
            return
        path, part = waiting.pop()
        yield path, part
        if "pandas_type" in part.attrs:
            raise Hdf5Error("it is a table of pandas; save it by its to_csv")
        if isinstance(part, Mapping):
            names = sorted((name for name in part if name[0] != "#"), key=natural_key, reverse=True)
            inside = ((f"{path}/{name}".lstrip("/"), part[name]) for name in names)
            waiting += [(name, each) for name, each in inside if each is not None]  # a dead link
    raise Hdf5Error(f"it has more than {MAX_PARTS} parts, or a group that holds itself")


def _numbers(path: str, part: Any) -> Iterator[tuple[str, Any]]:
    """Yield the path of numbers, and what has them: a dataset, an attribute."""
    attributes = dict(part.attrs)
    for name, value in attributes.items():
        text = value.decode(errors="replace") if isinstance(value, bytes) else value
        known = isinstance(text, np.number | np.ndarray | str)
        number = np.asarray(text) if known else np.empty(0)
        if number.size == 1 and number.dtype.kind in f"{NUMBERS}U":
            yield f"{path}/{name}".lstrip("/"), number
    left_out = attributes.get("MATLAB_class") in NO_NUMBERS or "MATLAB_empty" in attributes
    if isinstance(part, Mapping) or left_out:
        return
    kind = np.dtype(part.dtype)
    of_numbers = kind.kind in NUMBERS and "enum" not in (kind.metadata or {})
    if of_numbers or (kind.names and not kind.hasobject):
        yield path, part
