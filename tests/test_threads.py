"""Threads of PyTorch: how they wait, and how many there are."""

import os
import subprocess
import sys

import pytest
import torch

from tex_lightning.dispatch import set_threads


def spins(**given: str) -> str:
    """How often OpenMP itself says that it spins, when PyTorch is imported after this package."""
    free = {key: value for key, value in os.environ.items() if not key.startswith(("OMP", "GOMP"))}
    finished = subprocess.run(
        [sys.executable, "-c", "import tex_lightning, torch; torch.ones(1)"],
        env={**free, **given, "OMP_DISPLAY_ENV": "verbose"},
        capture_output=True,
        text=True,
        check=True,
    )
    said = [line for line in finished.stderr.splitlines() if "GOMP_SPINCOUNT" in line]
    if not said:
        pytest.skip("this OpenMP does not say how often it spins")
    return said[0].partition("=")[2].strip(" '")


def test_threads_sleep_while_they_wait_unless_the_user_says_otherwise():
    assert spins() == "0"
    assert int(spins(OMP_WAIT_POLICY="ACTIVE")) > 1000
    assert spins(GOMP_SPINCOUNT="1000") == "1000"


@pytest.mark.parametrize(
    ("task", "configured", "environment", "threads"),
    [
        ("stream", None, None, 1),
        ("predict", None, None, 2),  # as it was
        ("stream", 2, None, 2),
        ("stream", None, "2", 2),
        ("predict", 1, None, 1),
    ],
)
def test_a_stream_takes_one_thread_and_a_setting_of_the_user_wins(
    monkeypatch, task, configured, environment, threads
):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if environment is not None:
        monkeypatch.setenv("OMP_NUM_THREADS", environment)
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        set_threads(task, configured)
        assert torch.get_num_threads() == threads
    finally:
        torch.set_num_threads(before)
