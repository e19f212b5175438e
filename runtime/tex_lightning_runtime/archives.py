"""Signals in archives of named arrays: ``numpy.savez`` and MATLAB's before 7.3.

One array is the signal, several of one length are columns of a table, and a single number may be
the rate. Nothing in them is run: archives with pickled objects are refused.
"""

import math
import zipfile
from pathlib import Path

import numpy as np

from tex_lightning_runtime.samples import Array, axes_first

RATES = ("fs", "rate", "sampling_rate", "samplerate", "sample_rate", "sr", "frequency", "hz")
ARCHIVES = (".npz", ".mat")
NESTED = ("struct", "cell", "object", "opaque", "function")  # of SciPy's names of classes


def read_archive(path: Path, most: int) -> tuple[dict[str, Array], float | None]:
    """Return what :func:`signals_of` finds in an archive.

    Raises:
        ValueError: As there, or if the archive is damaged or claims more than ``most`` numbers.
    """
    return signals_of(_npz(path, most) if path.suffix.lower() == ".npz" else _mat(path, most))


def signals_of(arrays: dict[str, Array]) -> tuple[dict[str, Array], float | None]:
    """Return the signals among named arrays, and their rate in Hz if it is there.

    Several are (axes, samples) of one length.

    Raises:
        ValueError: If there is none, or several of other lengths.
    """
    arrays = {name: _seconds(each) for name, each in arrays.items() if each.dtype.kind in "fiuM"}
    rates = [float(each.item()) for name, each in arrays.items()
             if each.size == 1 and name.casefold() in RATES]  # fmt: skip
    known = len(rates) == 1 and math.isfinite(rates[0]) and rates[0] > 0
    signals = {name: np.squeeze(each) for name, each in arrays.items() if each.size > 1}
    if not signals:
        raise ValueError("it has no array of numbers; keep the signal, and its rate as fs")
    if len(signals) > 1:
        signals = _of_one_length(signals)
    return signals, rates[0] if known else None


def _seconds(array: Array) -> Array:
    """Return numbers (...) float64, moments as seconds since 1970."""
    moments = array.dtype.kind == "M"
    seconds = array.astype("datetime64[ns]").astype(np.int64) / 1e9 if moments else array
    return seconds.astype(np.float64)


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
            return {name: archive[name] for name in archive.files}
    except ValueError as error:
        if "pickle" in str(error):  # whose words propose to allow it
            raise ValueError("it holds pickled objects, which may run code, not arrays") from None
        raise
    except Exception as error:  # of any kind
        raise ValueError("it is no whole archive as np.savez writes it") from error


def _mat(path: Path, most: int) -> dict[str, Array]:
    try:
        from scipy.io import loadmat, whosmat
    except ImportError as error:
        raise ValueError("reading .mat takes SciPy: pip install scipy, or save .npy") from error
    try:
        listed = whosmat(path)
        # what has others inside does not say how many, and is no signal
        plain = [name for name, _, kind in listed if kind not in NESTED]
        claimed = sum(math.prod(shape) for name, shape, _ in listed if name in plain)
        found = loadmat(path, variable_names=plain) if plain and claimed <= most else {}
    except NotImplementedError as error:
        raise ValueError("it is of MATLAB 7.3 (HDF5); save it with the option -v7") from error
    except Exception as error:  # of any kind
        raise ValueError("it is no whole .mat file") from error
    if claimed > most:
        raise ValueError(f"it claims {claimed:,} numbers")
    if listed and not plain:
        raise ValueError("it has only structs or cells; save the signal as a variable of its own")
    return {name: each for name, each in found.items() if isinstance(each, np.ndarray)}
