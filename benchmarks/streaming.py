"""Load and delay of a live stream: HapticNet at the paper's width, on one core.

``python -m benchmarks streaming``. Load is processing time over signal time; every push ends with
the label of all samples so far.
"""

import time
from typing import Any

import numpy as np
import torch

from benchmarks._classifiers import make_classifier
from benchmarks.engine import DEFAULT
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.core.devices import computing_threads
from tex_lightning.inference.engine import accelerate
from tex_lightning.inference.sense_stream import SenseStream

RATE = 10_000
SECONDS = 60
CHUNKS = (0.01, 0.1, 1.0)


def measure() -> dict[str, Any]:
    """By normalisation and seconds of a chunk: load in % of a core, delay in ms."""
    with computing_threads(1):
        return {
            f"{norm}, chunks of {chunk:g} s": _replay(_classifier(norm), chunk)
            for norm in ("batch", "lrn")
            for chunk in CHUNKS
        }


def _classifier(norm: str) -> SurfaceClassifier:
    settings = "model=haptic", "model.haptic.width=1", f"model.haptic.norm={norm}"
    return accelerate(make_classifier(*settings, classes=69), DEFAULT)


def _replay(classifier: SurfaceClassifier, seconds: float) -> dict[str, float]:
    trace = torch.randn(1, SECONDS * RATE, generator=torch.Generator().manual_seed(0))
    size = round(seconds * RATE)
    warm = SenseStream(classifier, "haptic")
    for chunk in trace[:, : 5 * RATE].split(size, dim=1):
        warm.push(chunk)
    stream, spent = SenseStream(classifier, "haptic"), []
    for chunk in trace.split(size, dim=1):
        begin = time.perf_counter()
        stream.push(chunk)
        spent.append(time.perf_counter() - begin)
    return {
        "load_percent": 100 * sum(spent) / SECONDS,
        "delay_median_ms": 1000 * float(np.median(spent)),
        "delay_worst_ms": 1000 * max(spent),
    }
