"""Memory kept between passes through a network."""

import ctypes
import platform
import sys

import pytest
import torch

from tex_lightning.memory import kept_memory

FLOATS = 5_000_000  # of a tensor that glibc would return when it is freed for the first time


def faults() -> int:
    import resource  # not on every system

    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt


@pytest.mark.skipif(
    sys.platform == "win32" or platform.libc_ver()[0] != "glibc", reason="glibc's allocator"
)
def test_memory_is_cleared_once_while_kept():
    with kept_memory():
        torch.ones(FLOATS)
        before = faults()
        torch.ones(FLOATS)
        assert faults() - before < 500  # of 4883 pages


def test_other_systems_are_left_alone(monkeypatch):
    def refuse(*_: object) -> None:
        raise AssertionError("the library of another system was opened")

    monkeypatch.setattr(platform, "libc_ver", lambda: ("", ""))
    monkeypatch.setattr(ctypes, "CDLL", refuse)
    with kept_memory():
        assert torch.ones(3).sum() == 3
