"""How threads wait for each other, idle and beside busy processes.

``python -m benchmarks threads``

PyTorch's threads spin for a while before they sleep (OpenMP's own default), sleep at once
(``OMP_WAIT_POLICY=PASSIVE``, the package's default) or do not exist (one thread, the default of a
live stream). Each way runs in a process of its own, because OpenMP reads the policy once, beside 0,
1 and 2 processes that do nothing but compute. Measured are a training step, a label of a trace and
of a photo, and a chunk of a live stream, of the default networks.
"""

import json
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import nn

from benchmarks._classifiers import make_classifier
from benchmarks.engine import DEFAULT
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.inference.engine import accelerate
from tex_lightning.inference.streaming.classifier import StreamingClassifier
from tex_lightning.memory import kept_memory
from tex_lightning.profiling.timing import interleaved

WAYS: dict[str, tuple[dict[str, str], int | None]] = {
    "spinning": ({"GOMP_SPINCOUNT": "300000"}, None),  # as often as if nothing were set
    "sleeping": ({"OMP_WAIT_POLICY": "PASSIVE"}, None),  # PyTorch is imported first here
    "one thread": ({}, 1),
}
BUSY = (0, 1, 2)
BUDGET_S = 3.0  # of each measurement
RATE = 10_000


def measure() -> dict[str, Any]:
    """By busy processes and way of waiting: median and 95th percentile in ms of each work."""
    figures: dict[str, Any] = {}
    for count in BUSY:
        with busy(count):
            figures[f"{count} busy"] = {way: _in_a_process(way) for way in WAYS}
    return figures


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Let so many processes compute beside whatever is done inside."""
    context = multiprocessing.get_context("spawn")
    others = [context.Process(target=_spin, daemon=True) for _ in range(count)]
    for other in others:
        other.start()
    try:
        time.sleep(1.0 if others else 0)
        yield
    finally:
        for other in others:
            other.terminate()
            other.join()


def _spin() -> None:
    while True:
        sum(range(10_000))


def _in_a_process(way: str) -> dict[str, Any]:
    environment = {
        key: value for key, value in os.environ.items() if not key.startswith(("OMP_", "GOMP_"))
    }
    command = [sys.executable, "-m", "benchmarks.threads", way]
    done = subprocess.run(
        command,
        cwd=Path(__file__).parents[1],
        env=environment | WAYS[way][0],
        check=True,
        capture_output=True,
        text=True,
    )
    figures: dict[str, Any] = json.loads(done.stdout)
    return figures


def works() -> dict[str, Callable[[], object]]:
    """What is timed, by name."""
    torch.manual_seed(0)
    haptic, visual = (make_classifier(f"model={kind}") for kind in ("haptic", "visual"))
    trace, photo = torch.randn(1, 5 * RATE), torch.randint(256, (480, 640, 3), dtype=torch.uint8)
    large = torch.randint(256, (1224, 1632, 3), dtype=torch.uint8)
    fast, seeing = accelerate(haptic, DEFAULT), accelerate(visual, DEFAULT)
    return {
        "training step, haptic": _step(haptic.network, torch.randn(16, 1, 50, 300)),
        "training step, visual": _step(visual.network, torch.randn(16, 3, 224, 224)),
        "predict, trace of 5 s": partial(fast.classify, haptic=trace),
        "predict, photo of 0.3 megapixels": partial(seeing.classify, image=photo),
        "profile, photo of 2 megapixels": partial(seeing.classify, image=large),
        "stream, chunk of 0.1 s": _chunks(fast, trace),
    }


def _step(network: nn.Module, batch: torch.Tensor) -> Callable[[], None]:
    optimizer = torch.optim.AdamW(network.parameters())
    labels = torch.arange(len(batch)) % 16

    def step() -> None:
        logits = network(batch).flatten(2).mean(2)
        nn.functional.cross_entropy(logits, labels).backward()
        optimizer.step()
        optimizer.zero_grad()

    return step


def _chunks(classifier: SurfaceClassifier, trace: torch.Tensor) -> Callable[[], object]:
    stream = StreamingClassifier(classifier)
    stream.push(trace)
    chunk = trace[:, : RATE // 10]
    return lambda: stream.push(chunk)


def worker(way: str) -> dict[str, dict[str, float]]:
    """Time everything in this process."""
    threads = WAYS[way][1]
    if threads is not None:
        torch.set_num_threads(threads)
    with kept_memory():
        timings = {
            name: interleaved({name: work}, 1000, 2, budget_s=BUDGET_S)[name]
            for name, work in works().items()
        }
    return {
        name: {"median_ms": timing.median, "p95_ms": timing.p95} for name, timing in timings.items()
    }


if __name__ == "__main__":
    print(json.dumps(worker(sys.argv[1])))
