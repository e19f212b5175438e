"""Reject files of tensors that claim more memory than they hold, before it is allocated."""

import math
from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

MAX_BYTES = 1 << 31  # bytes that compressed arrays may become; published networks have a fifth
LARGEST_WEIGHT = 1e19  # squares of the largest samples that are read are smaller


def check_archive(file: Path | BytesIO) -> None:
    """Reject a zip archive that would expand to far more than its size.

    PyTorch and skops write their archives uncompressed; those of NumPy may be compressed.

    Raises:
        ValueError: If it would. What is no archive passes.
    """
    try:
        with ZipFile(file) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
    except BadZipFile:
        return
    stored = file.stat().st_size if isinstance(file, Path) else len(file.getbuffer())
    if size > max(MAX_BYTES, stored):
        raise ValueError("it would take up more memory than any network")


def check_weights(state: Mapping[str, Tensor]) -> None:
    """Reject weights that are NaN, infinite or absurdly large.

    Raises:
        ValueError: If there is NaN, infinity or a number that makes them.
    """
    for name, tensor in state.items():
        if tensor.dtype == torch.bool:
            continue
        if tensor.is_complex() or not bool((tensor.abs() < LARGEST_WEIGHT).all()):
            raise ValueError(f"{name} holds NaN or huge numbers")


def _range(start: float = 0, end: float | None = None, step: float = 1, **_: object) -> int:
    """Return the length of a range; of one argument it is the end."""
    low, high = (0, start) if end is None else (start, end)
    return math.ceil((high - low) / step)


# On the meta device PyTorch computes them by Python that takes seconds to import.
LENGTHS: dict[Any, Callable[..., int]] = {
    torch.arange: _range,
    torch.eye: lambda n, m=None, **_: n * (n if m is None else m),
    torch.hamming_window: lambda window_length, *_, **__: window_length,
    torch.hann_window: lambda window_length, *_, **__: window_length,
    torch.linspace: lambda start, end, steps, **_: steps,
    torch.logspace: lambda start, end, steps, *_, **__: steps,
}
TENSORS = {
    torch.empty, torch.empty_strided, torch.full, torch.ones, torch.rand, torch.randn, torch.zeros,
}  # fmt: skip
SPARE = 1 << 24  # numbers that features compute and no file holds, such as windows and filters


class SizeLimit(TorchFunctionMode):
    """Limit the numbers that modules may allocate while the context is entered.

    What a description asks for beyond its file is counted on the meta device and stopped before
    it takes memory.

    Args:
        size: Bytes of the file, and so more numbers than its weights are.
    """

    def __init__(self, size: int) -> None:
        super().__init__()
        self.weights, self.left = size, size + SPARE

    def __torch_function__(
        self,
        func: Any,  # noqa: ANN401
        types: Sequence[type],
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:  # noqa: ANN401
        """Count the memory that layers request; they allocate weights by ``torch.empty``."""
        named = kwargs or {}
        if func in LENGTHS or func in TENSORS:
            if func in LENGTHS:
                size = LENGTHS[func](*args, **named)
            else:
                size = func(*args, **{**named, "device": "meta"}).numel()
            self.left -= size
            self.weights -= size if func is torch.empty else 0
            if min(self.left, self.weights) < 0:
                raise ValueError("its network has more weights than the file")
        return func(*args, **named)
