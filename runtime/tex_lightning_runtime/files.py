"""Whether there is a file, whether it can be read, and in which order names come."""

import os
import re
from pathlib import Path

from tex_lightning_runtime.errors import UserError

POINTER, MAX_POINTER = b"version https://git-lfs", 1024  # bytes, in place of a large file
MAX_LINE = 1 << 20  # bytes; what goes on without a line's end is no table


def expanded(path: str | Path) -> Path:
    """Return the path with ``~`` replaced; there is no home folder of who has no account."""
    try:
        return Path(path).expanduser()
    except RuntimeError as error:
        raise UserError(
            f"Nobody's home folder is known for {path}; give a whole path, or set HOME."
        ) from error


def require_readable_name(path: Path) -> None:
    """Reject a path in bytes that are no text, which libraries and reports could not take."""
    try:
        str(path).encode()
    except UnicodeEncodeError as error:
        raise UserError(f"The path {path} is no text in UTF-8; rename the marked part.") from error


def require_file(path: Path) -> None:
    """Reject a path that is missing, empty or no file, a pointer, or no text."""
    require_readable_name(path)
    if not is_file(path):
        if os.path.lexists(path):
            raise UserError(
                f"File {path} is a folder, a device, a pipe or a broken link; give a file."
            )
        raise UserError(f"File {path} does not exist; check the path.")
    if (size := path.stat().st_size) == 0:
        raise UserError(f"File {path} is empty; record or copy it again.")
    if size < MAX_POINTER and os.access(path, os.R_OK) and path.read_bytes().startswith(POINTER):
        raise UserError(f"File {path} is a pointer of Git LFS; fetch its content by git lfs pull.")


def is_file(path: Path) -> bool:
    """Return whether there is a file; there is none of a name that is too long, or out of reach."""
    return os.path.isfile(path)  # noqa: PTH113  (which raises no errors)


def has_long_line(path: Path) -> bool:
    """Return whether a line is longer than :data:`MAX_LINE`, without reading it whole."""
    with path.open("rb") as stream:
        while len(content := stream.read(MAX_LINE)) == MAX_LINE:
            if b"\n" not in content and b"\r" not in content:
                return True
    return False


def natural_key(text: str) -> tuple[list[tuple[int, int, str]], str]:
    """Return a key that sorts ``query2`` before ``query10``; equal only for equal names."""
    parts = [
        (0, int(part), "") if part.isdecimal() else (1, 0, part.casefold())
        for part in re.split(r"(\d+)", text)
        if part
    ]
    return parts, text
