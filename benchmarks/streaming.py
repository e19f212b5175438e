"""Load and delay of a live stream: HapticNet at the paper's width, on one core.

``python -m benchmarks streaming``. Load is processing time over signal time; every push of 0.1 s
ends with the label of all samples so far, or of the last two seconds.
"""

import time
from typing import Any

import numpy as np
import torch

from benchmarks._classifiers import make_classifier
from benchmarks.engine import DEFAULT
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import StreamConfig
from tex_lightning.core.devices import computing_threads
from tex_lightning.inference.engine import accelerate
from tex_lightning.inference.stream import LiveStream

RATE = 10_000
SECONDS = 20
CHUNK = 0.1
WINDOWS = (None, 2.0)


def measure() -> dict[str, Any]:
    """By normalisation and seconds of the window: load in % of a core, delay in ms."""
    with computing_threads(1):
        return {
            f"{norm}, window of {window} s": _replay(_classifier(norm), window)
            for norm in ("batch", "lrn")
            for window in WINDOWS
        }


def _classifier(norm: str) -> SurfaceClassifier:
    settings = "model=haptic", "model.haptic.width=1", f"model.haptic.norm={norm}"
    return accelerate(make_classifier(*settings, classes=69), DEFAULT)


def _replay(classifier: SurfaceClassifier, window: float | None) -> dict[str, float]:
    trace = torch.randn(1, SECONDS * RATE, generator=torch.Generator().manual_seed(0))
    config = StreamConfig(chunk=CHUNK, window=window, axes=1)
    stream = LiveStream(classifier, {"haptic": None}, {}, config, top_k=1)
    spent = []
    for chunk in trace.split(round(CHUNK * RATE), dim=1):
        begin = time.perf_counter()
        stream.push(chunk)
        spent.append(time.perf_counter() - begin)
    return {
        "load_percent": 100 * sum(spent) / SECONDS,
        "delay_median_ms": 1000 * float(np.median(spent)),
        "delay_worst_ms": 1000 * max(spent),
    }
