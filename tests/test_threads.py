from threading import Thread

import torch

from tex_lightning.threads import computing_threads


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
