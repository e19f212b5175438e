"""Time and memory against the length of the signal, on one core: of a label, and of a live stream.

``python -m benchmarks length``. A stream is pushed 0.1 s after 10, 60, 120 and 600 s; its growth is
the time after 600 s by that after 10 s. The growth of a label is the time per minute of the longest
recording by that of the shortest: 1 is linear. Memory is what a process of its own takes beyond
what it took before, at most. Signals are noise and weights random; neither decides over the time.
"""

import resource
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
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
from tex_lightning.senses.features.proportions import BandProportions

SECONDS = (10, 60, 120, 600)
CHUNK, PUSHES = 0.1, 15
SLOW = 1000  # Hz, below which levels count
LABELS = (  # model, rate in Hz, axes, minutes
    ("experiment=few/haptic", 50, 1, (10, 20, 40, 60)),
    ("experiment=few/haptic", 50, 3, (10, 20, 40, 60)),
    ("experiment=few/haptic", 10_000, 1, (1, 10)),
    ("experiment=few/haptic", 10_000, 3, (1, 10)),
    ("model=haptic", 10_000, 1, (1, 10)),
    ("model=haptic", 10_000, 3, (1, 10)),
)
MODELS = (
    ("experiment=few/haptic", 10_000),
    ("experiment=few/haptic", 50),
    ("model=haptic", 10_000),
)


def measure() -> dict[str, Any]:
    """Seconds, MiB and growth of labels, milliseconds and growth of streams, by model and rate."""
    figures: dict[str, Any] = {}
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as pool:
        for model, rate in MODELS:
            figures[f"stream {model}, {rate} Hz"] = pool.submit(_stream, model, rate).result()
        for model, rate, axes, lengths in LABELS:
            label, times = f"label {model}, {rate} Hz, {axes} axes", []
            for minutes in lengths:
                seconds, memory = pool.submit(_label, model, rate, minutes, axes).result()
                figures[f"{label}, {minutes} min"] = {"seconds": seconds, "mib": memory}
                times.append(seconds / minutes)
            figures[label] = {"growth_ratio": times[-1] / times[0]}
    return figures


def _classifier(model: str, rate: int, axes: int) -> SurfaceClassifier:
    settings = [model, f"data.sampling_rate={rate}"]
    if rate < SLOW:
        settings.append(f"model.haptic.features.levels={axes}")
    classifier = accelerate(make_classifier(*settings), DEFAULT)
    features = classifier.senses["haptic"].features
    if isinstance(features, BandProportions):  # as of a training on long recordings
        features.fits.fill_(True)
        features._note_windows()
    return classifier


def _stream(model: str, rate: int) -> dict[str, float]:
    classifier, rng, found = _classifier(model, rate, 1), np.random.default_rng(0), {}
    stream = LiveStream(classifier, {"haptic": None}, {}, StreamConfig(CHUNK, None, 1), top_k=1)
    size = round(CHUNK * rate)
    with computing_threads(1):
        for place in range(1, round(SECONDS[-1] / CHUNK) + PUSHES + 1):
            begin = time.process_time()
            stream.push(rng.standard_normal(size))
            found[place] = 1000 * (time.process_time() - begin)
    after = {
        seconds: float(np.median([found[round(seconds / CHUNK) + more] for more in range(PUSHES)]))
        for seconds in SECONDS
    }
    times = {f"ms after {seconds} s": ms for seconds, ms in after.items()}
    return {"growth_ratio": after[SECONDS[-1]] / after[SECONDS[0]], **times}


def _label(model: str, rate: int, minutes: float, axes: int) -> tuple[float, float]:
    """Return seconds of the processor and MiB that one label takes, its resampling included."""
    classifier = _classifier(model, rate, axes)
    classifier.classify(haptic=torch.randn(axes, 20 * rate))
    shape = axes, round(60 * minutes * rate)
    signal = np.random.default_rng(0).standard_normal(shape, dtype=np.float32)
    before, begin = _peak(), time.process_time()
    with computing_threads(1):
        recording, _ = classifier.senses["haptic"].resample(signal, rate, {}, "noise")  # type: ignore[attr-defined]
        classifier.classify(haptic=recording)
    return time.process_time() - begin, _peak() - before


def _peak() -> float:
    """Return the most memory that this process has had, in MiB; of Linux, where it is in KiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
