"""Traces that are read to learn their rate, kept in memory until they are decoded at it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar

from tex_lightning_runtime.files import is_file

MAX_KEPT = 1 << 28  # bytes of samples; a file beyond them is read again

T = TypeVar("T", bound=tuple[Any, ...])

_kept: dict[tuple[object, ...], Any] = {}
_lock = Lock()  # files are read in threads
_keeps, _bytes = False, 0  # bytes that were kept since all was freed


@contextmanager
def keeping_traces() -> Iterator[None]:
    """Keep what :func:`read_once` reads meanwhile."""
    global _keeps
    _keeps = True
    try:
        yield
    finally:
        _keeps = False


def forget_traces() -> None:
    """Free what is kept."""
    global _bytes
    with _lock:
        _kept.clear()
        _bytes = 0


def read_once(read: Callable[..., T], path: Path, *how: Any) -> T:  # noqa: ANN401
    """Return ``read(path, *how)``, or what an earlier call has kept of it, which is then freed.

    Args:
        read: Reads a tuple that begins with samples.
        path: File that it reads; a file that has changed since is read again.
        *how: Further arguments.

    Raises:
        UserError: As ``read`` does.
    """
    stat = path.stat() if is_file(path) else None  # of any of the files of a trace
    key = (read, path, how, stat and (stat.st_mtime_ns, stat.st_size))
    global _bytes
    with _lock:
        kept: Any = _kept.get(key) if _keeps else _kept.pop(key, None)
    if kept is not None:
        return kept  # type: ignore[no-any-return]  # what read has returned
    result = read(path, *how)
    size = result[0].nbytes
    with _lock:
        if _keeps and key not in _kept and _bytes + size <= MAX_KEPT:
            _kept[key] = result
            _bytes += size
    return result
