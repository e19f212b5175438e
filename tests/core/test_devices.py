"""The choice of a device, and of how exactly it computes."""

import time
from threading import Thread

import cv2
import numpy as np
import pytest
import torch

import tex_lightning as tl
from tex_lightning.core.devices import computing_threads, in_threads, torch_defaults


@pytest.fixture
def flags():
    """PyTorch's own flags, which are put back."""
    backends = torch.backends.cudnn, torch.backends.cuda.matmul
    before = [backend.allow_tf32 for backend in backends]
    yield lambda: [backend.allow_tf32 for backend in backends]
    for backend, value in zip(backends, before, strict=True):
        backend.allow_tf32 = value


def test_a_loaded_network_is_exact_unless_it_is_told_otherwise(flags, untrained):
    torch.backends.cudnn.allow_tf32 = True
    tl.load(untrained / "checkpoints" / "haptic.ckpt")
    assert flags() == [False, False]
    tl.load(untrained / "checkpoints" / "haptic.ckpt", "trainer.tf32=true")
    assert flags() == [True, True]


def in_a_thread() -> int:
    """How many threads PyTorch uses in a thread that begins now."""
    found: list[int] = []
    thread = Thread(target=lambda: found.append(torch.get_num_threads()))
    thread.start()
    thread.join()
    return found[0]


def test_defaults_of_a_program_are_not_used_and_stay_as_they_are(untrained):
    """Some fields compute in float64, and put every new tensor on their GPU."""
    drawn, generated = np.random.get_state(), torch.random.get_rng_state()  # noqa: NPY002
    torch.set_default_dtype(torch.float64)
    torch.set_default_device("meta")
    try:
        tl.load(untrained / "checkpoints" / "haptic.ckpt")
        with torch_defaults():
            np.random.seed(1)  # noqa: NPY002  (as aeon does)
            torch.manual_seed(1)
            torch.use_deterministic_algorithms(True)  # as trainer.deterministic=true does
            made = torch.ones(1)
            assert (made.dtype, made.device.type) == (torch.float32, "cpu")
        made = torch.ones(1)
        assert (made.dtype, made.device.type) == (torch.float64, "meta")
    finally:
        torch.set_default_dtype(torch.float32)
        torch.set_default_device(None)
    assert not torch.are_deterministic_algorithms_enabled()
    assert torch.equal(torch.random.get_rng_state(), generated)
    assert (np.random.get_state()[1] == drawn[1]).all()  # noqa: NPY002


def test_threads_are_as_many_as_asked_for_and_as_before_afterwards():
    before = torch.get_num_threads()
    for count in (1, before + 2):
        with computing_threads(count):
            assert torch.get_num_threads() == in_a_thread() == count
        assert torch.get_num_threads() == in_a_thread() == before
    with computing_threads():
        torch.set_num_threads(before + 1)
    assert torch.get_num_threads() == before


def test_work_in_threads_comes_back_in_order_each_on_one_thread():
    opencv, before = cv2.getNumThreads(), torch.get_num_threads()
    found = in_threads(lambda n: (n, cv2.getNumThreads(), torch.get_num_threads()), range(20), "")
    assert found == [(n, 1, 1) for n in range(20)]
    assert (cv2.getNumThreads(), torch.get_num_threads()) == (opencv, before)


def test_after_an_interruption_only_what_has_begun_is_ended():
    begun = []

    def work(number):
        begun.append(number)
        time.sleep(0.01)
        if number == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        in_threads(work, range(1000), "")
    assert len(begun) < 500
