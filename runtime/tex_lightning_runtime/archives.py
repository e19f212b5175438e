"""Signals in archives of named arrays: ``numpy.savez`` and MATLAB's before 7.3.

One array is the signal, and a single number may be its rate. Nothing in them is run: archives with
pickled objects are refused.
"""

import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

RATES = ("fs", "rate", "sampling_rate", "samplerate", "sample_rate", "sr", "frequency", "hz")
ARCHIVES = (".npz", ".mat")
NESTED = ("struct", "cell", "object", "opaque", "function")  # of SciPy's names of classes


def read_archive(path: Path, most: int) -> tuple[np.ndarray[Any, Any], float | None]:
    """Return the samples of the only signal in an archive, and their rate in Hz if it has it.

    Raises:
        ValueError: If it has none or several, or is damaged.
    """
    arrays = _npz(path, most) if path.suffix.lower() == ".npz" else _mat(path, most)
    numeric = {name: each for name, each in arrays.items() if each.dtype.kind in "fiu"}
    signals = [name for name, each in numeric.items() if each.size > 1]
    if len(signals) != 1:
        named = f"the arrays {', '.join(signals)}" if signals else "no array of numbers"
        raise ValueError(f"it has {named}; keep the signal alone, and its rate as fs")
    rates = [float(each.item()) for name, each in numeric.items()
             if each.size == 1 and name.casefold() in RATES]  # fmt: skip
    known = len(rates) == 1 and math.isfinite(rates[0]) and rates[0] > 0
    return np.squeeze(np.array(numeric[signals[0]], np.float64)), rates[0] if known else None


def _npz(path: Path, most: int) -> dict[str, np.ndarray[Any, Any]]:
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


def _mat(path: Path, most: int) -> dict[str, np.ndarray[Any, Any]]:
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
