"""How many threads PyTorch computes with on the CPU."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def computing_threads(count: int | None = None) -> Iterator[None]:
    """Let PyTorch use so many threads, and as many as before when that is over.

    Args:
        count: For this thread and those that begin meanwhile; None changes nothing itself, and
            undoes what a library changes.
    """
    before = torch.get_num_threads()
    if count is not None:
        torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
