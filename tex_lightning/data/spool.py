"""Tensors that are kept in an unnamed file and not in memory."""

import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import IO

import numpy as np
import torch
from torch import Tensor

from tex_lightning.errors import UserError


def spooled(items: Iterable[Tensor], folder: Path) -> tuple[Tensor, list[int]]:
    """Join tensors on the CPU along their first axis in a file, of which memory holds what is read.

    The system writes the pages to disk and drops them when memory is short. The file has no name
    and is gone with the tensor.

    Args:
        items: (length, ...) each, at least one, of one type; one at a time is in memory.
        folder: Folder of the file; where it can only be read, the system's temporary one.

    Returns:
        (lengths together, ...), and the length of each.

    Raises:
        UserError: If the disk is full.
    """
    lengths: list[int] = []
    try:
        with _unnamed_file(folder) as file:
            for item in items:
                array = np.ascontiguousarray(item)
                lengths.append(len(array))
                file.write(array.data)
            file.flush()
            # copy-on-write: PyTorch has no read-only tensors, and nothing writes to it
            joined = np.memmap(file, array.dtype, "c", shape=(sum(lengths), *array.shape[1:]))
    except OSError as error:
        raise UserError(
            f"Features cannot be written to {folder} ({error.strerror}); free some space or set "
            "data.cache_dir to a larger disk."
        ) from error
    return torch.from_numpy(joined), lengths


def _unnamed_file(folder: Path) -> IO[bytes]:
    try:
        return tempfile.TemporaryFile(dir=folder)
    except OSError:  # a cache that several share
        return tempfile.TemporaryFile()
