"""Silence the libraries that read damaged files, since one sentence of this package names them."""

import ctypes
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from PIL import _imaging

_LOCK = threading.Lock()
# Those before, once for each thread that reads.
_FILTERS: list["warnings.catch_warnings[None]"] = []


@contextmanager
def quietly() -> Iterator[None]:
    """Keep what libraries warn of while they read, in any number of threads.

    The filters of warnings are those of the process: the first thread sets them aside, the last
    puts them back.
    """
    with _LOCK:
        if not _FILTERS:
            before = warnings.catch_warnings(record=False)
            before.__enter__()
            for category in (UserWarning, RuntimeWarning):
                warnings.simplefilter("ignore", category)
        else:
            before = _FILTERS[0]
        _FILTERS.append(before)
    try:
        yield
    finally:
        with _LOCK:
            before = _FILTERS.pop()
            if not _FILTERS:
                before.__exit__(None, None, None)


@cache
def silence_libtiff() -> None:
    """Let the libtiff that comes with Pillow print nothing; another one may."""
    home = Path(_imaging.__file__).parents[1]
    for folder in ("pillow.libs", "PIL/.dylibs"):
        for library in (home / folder).glob("libtiff*"):
            ctypes.CDLL(str(library)).TIFFSetErrorHandler(None)
