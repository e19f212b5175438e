"""Reuse the memory that every pass through a network allocates and frees."""

import ctypes
import platform
from collections.abc import Iterator
from contextlib import contextmanager

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # what glibc's malloc.h calls M_...
LARGE = 1 << 30  # bytes; hardly a tensor on a CPU comes near
GROWN = 1 << 25  # to which glibc lets its own threshold grow, and many versions no further


def is_out_of_memory(error: Exception) -> bool:
    """Whether NumPy or PyTorch, on any device, got less memory than was asked for."""
    return isinstance(error, MemoryError) or "allocate" in str(error)


@contextmanager
def kept_memory() -> Iterator[None]:
    """Keep the freed memory of CPU tensors for the next ones, inside the context.

    The allocator of glibc returns large pieces to the system, which has to clear every page when
    it is asked for again: a few percent of a training step.
    Other systems are left as they are.
    Afterwards all is returned, and the thresholds are the largest that glibc chooses by itself.
    """
    if platform.libc_ver()[0] != "glibc":
        yield
        return
    libc = ctypes.CDLL(None)
    libc.mallopt(MMAP_THRESHOLD, LARGE) or libc.mallopt(MMAP_THRESHOLD, GROWN)
    libc.mallopt(TRIM_THRESHOLD, LARGE)
    try:
        yield
    finally:
        libc.mallopt(MMAP_THRESHOLD, GROWN)
        libc.mallopt(TRIM_THRESHOLD, 2 * GROWN)
        libc.malloc_trim(0)
