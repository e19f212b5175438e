"""Refuse files of tensors that claim more than they hold, before memory is allocated."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

LARGEST = 1 << 31  # bytes that compressed arrays may become; published networks have a fifth
LARGEST_WEIGHT = 1e15


def check_archive(file: Path | BytesIO) -> None:
    """Refuse a zip archive that would expand to far more than its size.

    PyTorch and skops write their archives uncompressed; those of NumPy may be compressed.

    Raises:
        ValueError: If it would. What is no archive passes.
    """
    try:
        with ZipFile(file) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
    except BadZipFile:
        return
    if size > LARGEST and size > _size(file):
        raise ValueError("it would take up more memory than any network")


def _size(file: Path | BytesIO) -> int:
    return file.stat().st_size if isinstance(file, Path) else len(file.getbuffer())


def check_numbers(state: Mapping[str, Tensor]) -> None:
    """Refuse weights that no training produces.

    Raises:
        ValueError: If there is NaN, infinity or a number that makes them.
    """
    for name, tensor in state.items():
        if tensor.is_complex() or not bool((tensor.abs() < LARGEST_WEIGHT).all()):
            raise ValueError(f"{name} holds NaN or huge numbers")


class SizeLimit(TorchFunctionMode):
    """Limit the numbers that layers may allocate while the context is entered.

    A network whose description asks for more than its file holds is stopped before it takes memory.

    Args:
        most: Numbers, such as the bytes of the file.
    """

    def __init__(self, most: int) -> None:
        super().__init__()
        self.left = most

    def __torch_function__(
        self,
        func: Any,  # noqa: ANN401
        types: Sequence[type],
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:  # noqa: ANN401
        """Count what ``torch.empty`` is asked for, as layers do."""
        if func is torch.empty and args:
            self.left -= prod(args[0] if isinstance(args[0], Sequence) else args)
            if self.left < 0:
                raise ValueError("its network has more weights than the file")
        return func(*args, **(kwargs or {}))
