"""How PyTorch's threads wait for each other: labels of a trace and a photo, a step of HapticNet.

``python -m benchmarks threads --spins=passive,300,1000,3000 --busy=0,1,2``

OpenMP reads its settings once, so every one is measured in a process of its own: asleep at once
(``passive``), or after so many turns of a loop (``GOMP_SPINCOUNT``); beside so many busy processes.
"""

import json
import os
import subprocess
import sys
from typing import Any

import torch
from torch import nn

from benchmarks._classifiers import make_classifier
from benchmarks.engine import DEFAULT
from tex_lightning.config import CONF
from tex_lightning.core.devices import keep_memory
from tex_lightning.inference.engine import accelerate
from tex_lightning.studies.timing import interleaved

SETTINGS = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME", "OMP_NUM_THREADS")
BUSY = (sys.executable, "-c", "while True: pass")
SECONDS, RATE = 4.8, 10_000
BATCH, SIZE = 8, (50, 256)  # spectrograms in a training step, as in the recipe
PHOTO = (480, 640, 3)
LABELS, STEPS = 60, 40


def measure(spins: str = "passive,100,300,1000,3000,10000", busy: str = "0,1,2") -> dict[str, Any]:
    """Return median and 95th percentile in ms by setting and number of busy processes."""
    return {
        f"{spin}, {count} busy": _beside(int(count), spin)
        for count in busy.split(",")
        for spin in spins.split(",")
    }


def _beside(count: int, spin: str) -> dict[str, float]:
    """Time in a process with this setting, beside so many that compute."""
    environment = {key: value for key, value in os.environ.items() if key not in SETTINGS}
    environment["PYTHONPATH"] = str(CONF.parent)
    environment |= {"OMP_WAIT_POLICY": "PASSIVE"} if spin == "passive" else {SETTINGS[1]: spin}
    others = [subprocess.Popen(BUSY) for _ in range(count)]
    try:
        command = [sys.executable, "-m", "benchmarks.threads"]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    finally:
        for other in others:
            other.kill()
            other.wait()
    figures: dict[str, float] = json.loads(done.stdout)
    return figures


def _here() -> dict[str, float]:
    """Time a label and a training step in this process, with as many threads as cores."""
    keep_memory()
    plain = make_classifier("model=haptic")
    quick, trace = accelerate(plain, DEFAULT), torch.randn(1, round(SECONDS * RATE))
    seeing, photo = accelerate(make_classifier("model=visual"), DEFAULT), torch.zeros(PHOTO).byte()
    labels = {
        "label": lambda: quick.classify(haptic=trace),
        "photo": lambda: seeing.classify(image=photo),
    }
    with torch.inference_mode():
        label = interleaved(labels, LABELS, warm_up=10)
    network, batch = plain.network.train(), torch.randn(BATCH, 1, *SIZE)
    optimiser = torch.optim.SGD(network.parameters(), lr=1e-3)

    def step() -> None:
        optimiser.zero_grad()
        scores = network(batch).flatten(2).mean(dim=2)
        nn.functional.cross_entropy(scores, torch.zeros(BATCH, dtype=torch.long)).backward()
        optimiser.step()

    timings = {**label, **interleaved({"step": step}, STEPS, warm_up=3)}
    return {
        f"{name}_{key}": round(value, 2)
        for name, timing in timings.items()
        for key, value in (("ms", timing.median), ("p95", timing.p95))
    }


if __name__ == "__main__":
    print(json.dumps(_here()))
