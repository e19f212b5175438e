"""Files that are whole or not there."""

import csv
import os
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import asdict, fields
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tex_lightning.errors import UserError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def require_file(path: Path) -> None:
    """Refuse a file that is missing or empty."""
    if not path.is_file():
        raise UserError(f"File {path} does not exist; check the path.")
    if path.stat().st_size == 0:
        raise UserError(f"File {path} is empty; record or copy it again.")


def matches(pattern: str) -> list[Path]:
    """Paths that match a pattern such as ``DIR/*.wav``; ``**`` stands for any folders."""
    return [Path(name) for name in glob(pattern, recursive=True)]  # noqa: PTH207  (may be absolute)


def write_lines(target: Path, kind: "type[DataclassInstance]", lines: Iterable[Any]) -> None:
    """Write a CSV that is whole or not there: a line for each dataclass of ``kind``."""

    def write(path: Path) -> None:
        with path.open("w", newline="", encoding="utf-8") as stream:
            names = [entry.name for entry in fields(kind)]
            writer = csv.DictWriter(stream, names, lineterminator="\n")
            writer.writeheader()
            writer.writerows(map(asdict, lines))

    write_atomically(target, write)


def write_text(target: Path, text: str) -> None:
    """Write a text file that is whole or not there."""
    write_atomically(target, lambda path: _write(path, text))


def write_bytes(target: Path, content: bytes) -> None:
    """Write a file that is whole or not there."""
    write_atomically(target, lambda path: _write_bytes(path, content))


def _write_bytes(path: Path, content: bytes) -> None:
    path.write_bytes(content)


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def write_atomically(target: Path, write: Callable[[Path], None]) -> None:
    """Let ``write`` fill a file beside ``target`` and move it there when it is whole."""
    partial: Path | None = None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        os.close(handle)
        partial = Path(name)
        write(partial)
        partial.chmod(0o644)
        partial.replace(target)
    except OSError as error:
        raise UserError(
            f"Cannot write {target} ({error.strerror}); free some space or choose another folder."
        ) from error
    finally:
        if partial is not None:
            partial.unlink(missing_ok=True)
