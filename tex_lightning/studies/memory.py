"""How much memory one forward pass takes, in a process of its own.

Memory that a process has freed and kept hides what is taken next, and scratch space of the
libraries escapes PyTorch's own count, so the resident size of a fresh process is what is compared.
"""

import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context, get_start_method, set_start_method
from pathlib import Path

import torch
from torch import Tensor

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig
from tex_lightning.config.instantiation import named_classes, trust
from tex_lightning.inference.engine import accelerate
from tex_lightning.senses.base import Sense
from tex_lightning.studies.timing import like_weights, only_branch

STATUS = Path("/proc/self/status")
RESET = Path("/proc/self/clear_refs")
RESET_PEAK = "5"  # proc(5): set the peak resident size to the present one
# mallopt(3): glibc then gives every freed block of this size back, and keeps none to hide the next
RETURNED = {"MALLOC_MMAP_THRESHOLD_": "65536"}


def forward_peak_mib(
    card: Card, engine: EngineConfig, shape: tuple[int, ...], device: torch.device
) -> float | None:
    """Largest memory in MiB that one forward pass holds beyond weights and input.

    The weights are random and nothing is compiled; neither changes the figure of what runs.

    Args:
        card: Card of a unimodal classifier.
        engine: How it is accelerated.
        shape: Shape of the input (1, C, H, W).
        device: Where it runs.

    Returns:
        None where the system cannot tell (it takes Linux or a CUDA device).
    """
    if device.type == "cuda":
        return _cuda_peak(card, engine, shape, device)
    if device.type != "cpu" or not RESET.exists():
        return None
    spawn = get_context("spawn")
    with _environment(RETURNED), _by_default("spawn"), ProcessPoolExecutor(1, spawn) as pool:
        return pool.submit(_resident_peak, card, engine, shape, torch.get_num_threads()).result()


@contextmanager
def _by_default(method: str) -> Iterator[None]:
    """Tell new processes of this start method: that of a job of joblib's is known to it alone."""
    before = get_start_method(allow_none=True)
    set_start_method(method, force=True)
    try:
        yield
    finally:
        set_start_method(before, force=True)


@contextmanager
def _environment(extra: dict[str, str]) -> Iterator[None]:
    """Environment variables for the processes that are started meanwhile."""
    before = os.environ.copy()
    os.environ.update(extra)
    try:
        yield
    finally:
        for key in extra:
            os.environ.pop(key)
        os.environ.update(before)


def _resident_peak(
    card: Card, engine: EngineConfig, shape: tuple[int, ...], threads: int
) -> float | None:
    torch.set_num_threads(threads)
    trust(*named_classes(card.senses))  # as in the process that has built it
    sense, x = _prepared(card, engine, shape, torch.device("cpu"))
    height, width = sense.window_size
    with torch.inference_mode():
        # the libraries' own beginnings are no part of the figure
        sense.dense(x[..., :height, :width], "fc3")
        try:
            RESET.write_text(RESET_PEAK)
        except OSError:
            return None
        before = _kib("VmRSS")
        sense.dense(x, "fc3")
    return (_kib("VmHWM") - before) / 1024


def _kib(key: str) -> int:
    lines = STATUS.read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{key}:"))


def _cuda_peak(
    card: Card, engine: EngineConfig, shape: tuple[int, ...], device: torch.device
) -> float:
    sense, x = _prepared(card, engine, shape, device)
    with torch.inference_mode():
        torch.cuda.reset_peak_memory_stats(device)
        before = torch.cuda.memory_allocated(device)
        sense.dense(x, "fc3")
    return (torch.cuda.max_memory_allocated(device) - before) / 2**20


def _prepared(
    card: Card, engine: EngineConfig, shape: tuple[int, ...], device: torch.device
) -> tuple[Sense, Tensor]:
    """The sense of an accelerated classifier, and an input."""
    sense = only_branch(accelerate(SurfaceClassifier(card).eval().to(device), engine))
    return sense, like_weights(sense.network, torch.randn(shape))
