"""The choice of a device, and of how exactly it computes."""

import platform
import subprocess
import sys
from threading import Thread

import pytest
import torch

import tex_lightning as tl
from tex_lightning.core.devices import computing_threads


@pytest.fixture
def flags():
    """PyTorch's own flags, which are put back."""
    backends = torch.backends.cudnn, torch.backends.cuda.matmul
    before = [backend.allow_tf32 for backend in backends]
    yield lambda: [backend.allow_tf32 for backend in backends]
    for backend, value in zip(backends, before, strict=True):
        backend.allow_tf32 = value


def test_a_command_uses_tf32_where_it_is_asked_to(cli, flags, tmp_path):
    torch.backends.cudnn.allow_tf32 = torch.backends.cuda.matmul.allow_tf32 = False
    cli("task=predict", "checkpoint=none.ckpt", f"hydra.run.dir={tmp_path}", "trainer.tf32=true")
    assert flags() == [True, True]


def test_a_loaded_network_is_exact_unless_it_is_told_otherwise(flags, untrained):
    torch.backends.cudnn.allow_tf32 = True
    tl.load(untrained / "checkpoints" / "haptic.ckpt")
    assert flags() == [False, False]
    tl.load(untrained / "checkpoints" / "haptic.ckpt", "trainer.tf32=true")
    assert flags() == [True, True]


# in a process of its own, whose heap nothing else has cut into pieces
SCRIPT = """
import ctypes, resource, sys, torch
from tex_lightning.core.devices import LARGE, MMAP_THRESHOLD, keep_memory

if sys.argv[1:]:
    if not ctypes.CDLL(None).mallopt(MMAP_THRESHOLD, LARGE):
        sys.exit("refused")
    keep_memory()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(30):
    torch.ones(16_000_000)  # 64 MB, which glibc by itself always returns
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def count_faults(*arguments: str) -> int:
    command = [sys.executable, "-c", SCRIPT, *arguments]
    finished = subprocess.run(command, capture_output=True, text=True)
    if "refused" in finished.stderr:
        pytest.skip("this glibc keeps its own threshold")
    return int(finished.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc's allocator")
def test_pages_are_cleared_a_few_times_while_kept_and_not_for_every_tensor():
    assert count_faults("kept") < 0.5 * count_faults()


def in_a_thread() -> int:
    """How many threads PyTorch uses in a thread that begins now."""
    found: list[int] = []
    thread = Thread(target=lambda: found.append(torch.get_num_threads()))
    thread.start()
    thread.join()
    return found[0]


def test_threads_are_as_many_as_asked_for_and_as_before_afterwards():
    before = torch.get_num_threads()
    for count in (1, before + 2):
        with computing_threads(count):
            assert torch.get_num_threads() == in_a_thread() == count
        assert torch.get_num_threads() == in_a_thread() == before
    with computing_threads():
        torch.set_num_threads(before + 1)
    assert torch.get_num_threads() == before
