"""Whether there is a file that can be read."""

import os
from pathlib import Path

from tex_lightning_runtime.errors import UserError


def require_file(path: Path) -> None:
    """Reject a path that is missing, empty or no file."""
    if not is_file(path):
        if os.path.lexists(path):
            raise UserError(
                f"File {path} is a folder, a device, a pipe or a broken link; give a file."
            )
        raise UserError(f"File {path} does not exist; check the path.")
    if path.stat().st_size == 0:
        raise UserError(f"File {path} is empty; record or copy it again.")


def is_file(path: Path) -> bool:
    """Return whether there is a file; there is none of a name that is too long, or out of reach."""
    return os.path.isfile(path)  # noqa: PTH113  (which raises no errors)
