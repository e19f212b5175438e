"""Signals in archives of named arrays: ``numpy.savez``, MATLAB's, and HDF5.

One array is the signal, several of one length are columns of a table, and a single number may be
the rate, or the time between samples. What lies in structs and groups is as if it did not. Nothing
in them is run: pickled objects are left out, and refused where there is nothing else.
"""

import math
import re
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path

import numpy as np

from tex_lightning_runtime.hdf5 import NUMBERS, is_hdf5, read_hdf5
from tex_lightning_runtime.resampling import MAX_RATE, MIN_RATE
from tex_lightning_runtime.samples import Array, axes_first
from tex_lightning_runtime.stated_rates import PERIOD, RATE, stated_rate

HDF5 = (".h5", ".hdf5")
ARCHIVES = (".npz", ".mat", *HDF5)
NO_NUMBERS = ("cell", "logical", "object", "opaque", "function")  # of SciPy's classes
MATRIX = 16  # numbers of one for calibration, beside a signal
MANY = 3  # names in a message
LONGEST = 200  # letters of a text that may state a rate
COMPRESSED = 15  # a type of element of MATLAB's files


def read_archive(path: Path, most: int) -> tuple[dict[str, Array], float | None]:
    """Return what :func:`signals_of` finds in an archive.

    Raises:
        ValueError: As there, or if the archive is damaged or claims more than ``most`` numbers.
    """
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return signals_of(_npz(path, most))
    in_hdf5 = suffix in HDF5 or is_hdf5(path)
    return signals_of(read_hdf5(path, most) if in_hdf5 else _mat(path, most))


def signals_of(arrays: dict[str, Array]) -> tuple[dict[str, Array], float | None]:
    """Return the signals among named arrays, and their rate in Hz if it is there.

    Several are (axes, samples) of one length. Names are paths, as ``trial/acc``, and their last
    part is the name of a signal.

    Raises:
        ValueError: If there is none, or several of other lengths or of the same name.
    """
    plain = (each.shape for each in arrays.values() if each.dtype.kind in NUMBERS)
    longest = max(chain.from_iterable(plain), default=0)
    parts = chain.from_iterable(
        _fields(*item) for item in arrays.items()
        if item[1].dtype.names is None or not 1 < item[1].size < longest  # events beside a signal
    )  # fmt: skip
    kept = {name: each for name, each in parts if each.dtype.kind in f"{NUMBERS}MU"}
    arrays = {name: _numbers(each) for name, each in kept.items() if each.dtype.kind != "U"}
    texts = {name: each for name, each in kept.items() if name not in arrays}
    rate = _rate(arrays) or _rate(texts)
    signals = {name: one_recording(each) for name, each in arrays.items() if each.size > 1}
    longer = {name: each for name, each in signals.items() if each.ndim < 2 or each.size > MATRIX}
    signals = longer or signals
    if not signals:
        raise ValueError(
            "it has no array of numbers outside of cells and arrays of structs; keep the signal, "
            "and its rate as fs"
        )
    if len({*map(_leaf, signals)}) < len(signals):
        raise ValueError(
            f"it holds several recordings ({', '.join(sorted(signals)[:MANY])}); write each to a "
            "file of its own"
        )
    signals = {_leaf(name): each for name, each in signals.items()}
    if len(signals) > 1:
        signals = _of_one_length(signals)
    return signals, rate


def _fields(name: str, array: Array) -> Iterator[tuple[str, Array]]:
    """Yield an array by its path, or those of its fields, which may have fields."""
    if array.dtype.names is None:
        yield name, array
    for field in array.dtype.names or ():
        yield from _fields(f"{name}/{field}", array[field])


def one_recording(array: Array) -> Array:
    """Return an array without single dimensions at its ends; between others are recordings."""
    while array.ndim > 1 and 1 in (array.shape[0], array.shape[-1]):
        array = array[0] if len(array) == 1 else array[..., 0]
    return array


def _leaf(name: str) -> str:
    return name.rpartition("/")[2]


def _rate(arrays: Mapping[str, Array]) -> float | None:
    """Return the rate in Hz that single numbers or texts state by name, as lines above a table do.

    None if there is none, or several; ``rate`` beside ``fs`` is that of something else. A text
    begins with the number, so that prose is none, and a step of ``x`` may be one of length.
    """
    sure, rates = set[float](), set[float]()
    for name, each in ((_leaf(name), each) for name, each in arrays.items() if each.size == 1):
        value = str(each.item())[:LONGEST] if each.dtype.kind == "U" else f"{each.item():.9e}"
        rate = stated_rate([line := f"{name} = {value}"])
        is_rate = rate and (MIN_RATE <= rate <= MAX_RATE or not PERIOD.search(line))
        other = not value[:1].isdigit() or re.fullmatch("freq|.*x.*", name.casefold())
        if is_rate and not other:
            of_samples = RATE.search(line) or PERIOD.search(line)
            (sure if of_samples else rates).add(float(f"{rate:.9g}"))
    told = sure or rates
    return told.pop() if len(told) == 1 else None


def _numbers(array: Array) -> Array:
    """Return numbers (...) float64, and moments as nanoseconds since 1970.

    These and others of 64 bits stay whole: rounded to float64, times of a fast sensor are uneven.
    """
    if array.dtype.kind == "M":
        return array.astype("datetime64[ns]").astype(np.int64)
    return array.astype(np.int64 if array.dtype.str[1:] == "i8" else np.float64)


def _of_one_length(signals: dict[str, Array]) -> dict[str, Array]:
    rows = {name: axes_first(array) for name, array in signals.items()}
    found = {name: each for name, each in rows.items() if each is not None}
    if len(found) < len(rows) or len({each.shape[1] for each in found.values()}) > 1:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in signals.items())
        raise ValueError(f"it has {shapes}; keep the signal alone, or arrays of one length")
    return found


def _npz(path: Path, most: int) -> dict[str, Array]:
    try:
        with zipfile.ZipFile(path) as archive:
            claimed = sum(each.file_size for each in archive.infolist())
        if claimed > 8 * most:
            raise ValueError(f"it claims {claimed:,} bytes")
        with np.load(path, allow_pickle=False) as archive:
            found = {name: _plain(archive, name) for name in archive.files}
    except ValueError:
        raise
    except Exception as error:  # of any kind
        raise ValueError("it is no whole archive as np.savez writes it") from error
    arrays = {name: each for name, each in found.items() if each is not None}
    if found and not arrays:
        raise ValueError("it holds pickled objects, which may run code, not arrays")
    return arrays


def _plain(archive: Mapping[str, Array], name: str) -> Array | None:
    """Return an array, None in place of pickled objects, such as a dict of notes."""
    try:
        return archive[name]
    except ValueError as error:
        if "pickle" not in str(error):
            raise
        return None


def _mat(path: Path, most: int) -> dict[str, Array]:
    try:
        from scipy.io import loadmat, whosmat
    except ImportError as error:
        raise ValueError("reading .mat takes SciPy: pip install scipy, or save .npy") from error
    try:
        listed = [each for each in whosmat(path) if each[2] not in NO_NUMBERS]
        claimed = sum(math.prod(shape) for _, shape, _ in listed)
        # a struct does not say how much it holds, and a number takes a byte at least
        nested = any(kind == "struct" for _, _, kind in listed)
        held = _inflated(path, most) if nested else 0
        kept = [name for name, _, _ in listed] if max(claimed, held) <= most else []
        found = loadmat(path, variable_names=kept) if kept else {}
        parts = (_flat(name, found[name]) for name in kept if name in found)
        arrays = dict(chain.from_iterable(parts))
    except Exception as error:  # of any kind
        raise ValueError("it is no whole .mat file") from error
    if claimed > most:
        raise ValueError(f"it claims {claimed:,} numbers")
    if held > most:
        raise ValueError(f"its structs claim more than {most:,} bytes")
    return arrays


def _inflated(path: Path, most: int) -> int:
    """Count the bytes of a .mat file when it is not compressed, up to about ``most``."""
    data = path.read_bytes()
    if data[126:128] not in (b"IM", b"MI"):  # an older one, which compresses nothing
        return len(data)
    order = "<" if data[126:128] == b"IM" else ">"
    total, place = 0, 128  # behind the header
    while place + 8 <= len(data) and total <= most:
        kind, size = (int(each) for each in np.frombuffer(data, f"{order}u4", 2, place))
        if kind == COMPRESSED:
            inflate = zlib.decompressobj()
            content = data[place + 8 : place + 8 + size]
            while content and total <= most:
                total += len(inflate.decompress(content, most))
                content = inflate.unconsumed_tail
        else:
            total += size
        place += 8 + size
    return total


def _flat(name: str, value: Array) -> Iterator[tuple[str, Array]]:
    """Yield the arrays in a variable of MATLAB by their path; a struct has fields."""
    fields = value.dtype.names
    if fields is None:
        yield name, value
    elif value.size == 1:  # several are as many recordings
        for field in fields:
            yield from _flat(f"{name}/{field}", np.asarray(value[field].item()))
