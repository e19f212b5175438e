"""Atomic reading and writing of files: complete or absent."""

import csv
import errno
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex
from typing import Any, TextIO

from tex_lightning.errors import UserError, reason
from tex_lightning.text import from_cell, to_cell
from tex_lightning_runtime.files import is_file, require_file

# A folder or disk that cannot be written; anything else is a fault of the program.
UNWRITABLE = (
    errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM,
    errno.ENOTDIR, errno.EISDIR, errno.EEXIST,  # a file where a folder should be, or the reverse
)  # fmt: skip
MAX_FIELD = 1 << 30  # characters; votes for very many classes take more than csv's own limit
LARGEST_JSON = 64 << 20  # bytes; in memory it is many times as large


def standard_input() -> TextIO:
    """Return standard input.

    Raises:
        UserError: If it is closed, as that of services is.
    """
    if sys.stdin is None:
        raise UserError("Standard input is closed; send samples to it by a pipe, or give a file.")
    return sys.stdin


def resolved(path: Path) -> Path:
    """Return the path without links; unchanged if links are circular or it is no path."""
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError):
        return path.absolute()


def read_record(path: Path) -> dict[str, Any]:
    """Read a record of a run, such as ``results.json``.

    Raises:
        UserError: If it is damaged.
    """
    try:
        if not is_file(path):
            raise ValueError("it is no file")
        if path.stat().st_size > LARGEST_JSON:
            raise ValueError("it is larger than 64 MiB")
        content = json.loads(path.read_text(encoding="utf-8-sig"))
        if not isinstance(content, dict):
            raise ValueError("it is no JSON object")
    except (OSError, ValueError, RecursionError) as error:
        raise UserError(
            f"Record {path} is damaged ({reason(error)}); delete it and run its command again."
        ) from error
    return content


def read_or_empty(path: Path) -> dict[str, Any]:
    """Read a record of a run; empty where there is none."""
    return read_record(path) if path.is_file() else {}


def write_rows(target: Path, columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write a CSV that is whole or not there."""

    def write(path: Path) -> None:
        with path.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(map(to_cell, columns))
            writer.writerows(map(to_cell, row) for row in rows)

    write_atomically(target, write)


def read_rows(path: Path) -> list[dict[str, str]]:
    """Read what :func:`write_rows` wrote, a dictionary for each row."""
    if not is_file(path):  # a pipe would be waited for
        require_file(path)
    csv.field_size_limit(MAX_FIELD)
    with path.open(newline="", encoding="utf-8") as stream:
        columns, *rows = [list(map(from_cell, row)) for row in csv.reader(stream)] or [[]]
    return [dict(zip(columns, row, strict=False)) for row in rows]


def write_text(target: Path, text: str) -> None:
    """Write a text file that is whole or not there; bytes of a path that are no text are marked."""
    write_bytes(target, text.encode(errors="backslashreplace"))


def write_bytes(target: Path, content: bytes) -> None:
    """Write a file that is whole or not there."""
    write_atomically(target, lambda path: path.write_bytes(content))


def write_atomically(target: Path, write: Callable[[Path], object]) -> None:
    """Write a file beside ``target`` with ``write``, and move it there when it is complete.

    Raises:
        UserError: If it cannot be written, or is a folder, a device or a pipe.
    """
    try:
        if target.exists() and not is_file(target):  # a device would be replaced by the file
            raise UserError(f"{target} is a folder, a device or a pipe; give the path of a file.")
        with partial_path(target) as partial:
            write(partial)
            partial.replace(target)
    except OSError as error:
        raise unwritable(target, error) from error
    except RuntimeError as error:
        if "PytorchStreamWriter" in str(error) or "inline_container" in str(error):  # a full disk
            raise unwritable(target, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))) from error
        raise


def unwritable(path: str | Path, error: OSError) -> UserError:
    """Return the error for a file that cannot be written."""
    return UserError(
        f"Cannot write {path} ({error.strerror}); free some space or choose another folder."
    )


@contextmanager
def partial_path(target: Path, *, folder: bool = False) -> Iterator[Path]:
    """Yield a hidden path beside ``target``, to write and then rename; leftovers are deleted.

    A process that is killed leaves it, and nothing reads it.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(f".{target.name}.{token_hex(4)}")
    if folder:
        partial.mkdir()
    try:
        yield partial
    finally:
        if folder:
            shutil.rmtree(partial, ignore_errors=True)
        else:
            partial.unlink(missing_ok=True)
