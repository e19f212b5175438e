"""Time and memory against the length of the signal and the number of classes, on one core.

``python -m benchmarks length``, of ``--only=fits``, ``labels`` or ``streams`` alone. A stream is
pushed 0.1 s after 10, 60, 120 and 600 s; its growth is the time after 600 s by that after 10 s. The
growth of a label is the time per minute of the longest recording by that of the shortest, and of a
fit of classes, with ten recordings of 1.5 s at 1 kHz each, the time per class of the most by that
of the fewest: 1 is linear. Memory is what a process of its own takes beyond what it took before, at
most. Signals are noise and weights random, and classes tones in noise; none decides over the time.
"""

import resource
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from benchmarks._classifiers import make_classifier
from benchmarks.engine import DEFAULT
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import StreamConfig
from tex_lightning.core.devices import computing_threads
from tex_lightning.estimator import Estimator
from tex_lightning.inference.engine import accelerate
from tex_lightning.inference.stream import LiveStream
from tex_lightning.senses.features.proportions import BandProportions

Floats = npt.NDArray[np.float64]
SECONDS = (10, 60, 120, 600)
CHUNK, PUSHES = 0.1, 15
SLOW = 1000  # Hz, below which levels count
CLASSES, EACH, STROKE, FIT_RATE = (30, 100, 300), 10, 1.5, 1000.0
LABELS = (  # model, rate in Hz, axes, minutes
    ("experiment=few/haptic", 50, 1, (10, 20, 40, 60)),
    ("experiment=few/haptic", 50, 3, (10, 20, 40, 60)),
    ("experiment=few/haptic", 10_000, 1, (1, 5, 10)),
    ("experiment=few/haptic", 10_000, 3, (1, 5, 10)),
    ("model=haptic", 10_000, 1, (1, 5, 10)),
    ("model=haptic", 10_000, 3, (1, 5, 10)),
)
MODELS = (
    ("experiment=few/haptic", 10_000),
    ("experiment=few/haptic", 50),
    ("model=haptic", 10_000),
)


def measure(only: str = "") -> dict[str, Any]:
    """Seconds, MiB and growth of fits and labels, milliseconds and growth of streams."""
    parts = {"streams": _streams, "labels": _labels, "fits": _fits}
    figures: dict[str, Any] = {}
    for part in (only,) if only else parts:
        with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as pool:
            figures |= parts[part](pool)
    return figures


def _streams(pool: ProcessPoolExecutor) -> dict[str, Any]:
    return {
        f"stream {model}, {rate} Hz": pool.submit(_stream, model, rate).result()
        for model, rate in MODELS
    }


def _labels(pool: ProcessPoolExecutor) -> dict[str, Any]:
    figures: dict[str, Any] = {}
    for model, rate, axes, lengths in LABELS:
        label, times = f"label {model}, {rate} Hz, {axes} axes", []
        for minutes in lengths:
            seconds, memory = pool.submit(_label, model, rate, minutes, axes).result()
            figures[f"{label}, {minutes} min"] = {"seconds": seconds, "mib": memory}
            times.append(seconds / minutes)
        figures[label] = {"growth_ratio": times[-1] / times[0]}
    return figures


def _fits(pool: ProcessPoolExecutor) -> dict[str, Any]:
    figures: dict[str, Any] = {}
    for classes in CLASSES:
        seconds, memory, right = pool.submit(_fit, classes).result()
        figures[f"fit, {classes} classes"] = {"seconds": seconds, "mib": memory, "right": right}
    times = [figures[f"fit, {classes} classes"]["seconds"] / classes for classes in CLASSES]
    return {**figures, "fit": {"growth_ratio": times[-1] / times[0]}}


def _fit(classes: int) -> tuple[float, float, float]:
    """Return seconds and MiB of a fit, and which share of 300 new recordings is told right."""
    recordings = [_tones(kind, take) for kind in range(classes) for take in range(EACH)]
    labels = np.repeat(np.arange(classes), EACH)
    model, before, begin = Estimator(rate=FIT_RATE), _peak(), time.process_time()
    with computing_threads(1):
        model.fit(recordings, labels)
    seconds, memory = time.process_time() - begin, _peak() - before
    tested = np.resize(np.arange(classes), 300)
    found = model.predict([_tones(kind, EACH + place) for place, kind in enumerate(tested)])
    return seconds, memory, float((found == tested).mean())


def _tones(kind: int, take: int) -> Floats:
    """Return a recording of a class: three tones of its own that waver, in noise."""
    of_class, rng = np.random.default_rng([kind, 0]), np.random.default_rng([kind, 1, take])
    samples = round(STROKE * FIT_RATE)
    pitches, strengths = of_class.uniform(0.03, 0.45, 3), of_class.uniform(0.3, 1.5, 3)
    pitches = pitches * (1 + 0.02 * rng.standard_normal(3))
    phases = 2 * np.pi * pitches[:, None] * np.arange(samples)
    phases += 0.2 * rng.standard_normal((3, samples)).cumsum(axis=1)
    tones: Floats = strengths @ np.cos(phases) + 0.5 * rng.standard_normal(samples)
    return tones * np.exp(0.2 * rng.standard_normal())


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
