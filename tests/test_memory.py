"""Memory kept between passes through a network."""

import ctypes
import platform
import subprocess
import sys

import pytest
import torch

from tex_lightning.memory import kept_memory

# in a process of its own, whose heap nothing else has cut into pieces
SCRIPT = """
import contextlib, ctypes, resource, sys, torch
from tex_lightning.memory import LARGE, MMAP_THRESHOLD, kept_memory

def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

if sys.argv[1] == "kept" and not ctypes.CDLL(None).mallopt(MMAP_THRESHOLD, LARGE):
    sys.exit("refused")
with kept_memory() if sys.argv[1] == "kept" else contextlib.nullcontext():
    before = faults()
    for _ in range(30):
        torch.ones(16_000_000)  # 64 MB, which glibc by itself always returns
    print(faults() - before)
"""


def count_faults(how: str) -> int:
    command = [sys.executable, "-c", SCRIPT, how]
    finished = subprocess.run(command, capture_output=True, text=True)
    if "refused" in finished.stderr:
        pytest.skip("this glibc keeps its own threshold")
    return int(finished.stdout)


@pytest.mark.skipif(
    sys.platform == "win32" or platform.libc_ver()[0] != "glibc", reason="glibc's allocator"
)
def test_pages_are_cleared_a_few_times_while_kept_and_not_for_every_tensor():
    assert count_faults("kept") < 0.5 * count_faults("returned")


def test_other_systems_are_left_alone(monkeypatch):
    def refuse(*_: object) -> None:
        raise AssertionError("the library of another system was opened")

    monkeypatch.setattr(platform, "libc_ver", lambda: ("", ""))
    monkeypatch.setattr(ctypes, "CDLL", refuse)
    with kept_memory():
        assert torch.ones(3).sum() == 3
