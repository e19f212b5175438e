"""HapticNet against MiniRocket: from one decoded trace of 4.8 s to its label.

MiniRocket (Dempster et al. 2021) is aeon's, fitted on traces of the same classes and standardised
as it expects them, with one thread and with as many as PyTorch has. HapticNet has random weights,
which cost what trained ones do, and its time includes the features. The target is a tenth of
MiniRocket's time.

The traces are real where a folder ``shared/data`` lies beside the checkout, else rendered.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks._classifiers import configured
from tex_lightning.classifier.card import configured_card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.data.decode import SignalDecoder, Trace
from tex_lightning.errors import UserError
from tex_lightning.inference.engine import accelerate
from tex_lightning.studies.timing import interleaved
from tex_lightning.synthetic import make_materials
from tex_lightning.synthetic.specimen import Specimen
from tex_lightning.synthetic.tool import slide_tool

REAL = Path(__file__).resolve().parents[2] / "shared" / "data" / "lmt16"
SECONDS = 4.8
RATE = 10_000
CLASSES = 16
RECORDINGS = 3  # of each class, to fit MiniRocket on; its predictions cost the same with more
ROUNDS = 40


def measure() -> dict[str, Any]:
    """Time both interleaved."""
    labels, traces = _traces()
    haptic = _hapticnet(labels, traces)
    trace = torch.from_numpy(traces[0])
    threads = torch.get_num_threads()
    functions = {"hapticnet": partial(haptic.classify, haptic=trace)}
    for count in sorted({1, threads}):
        rocket = _minirocket(labels, traces, count)
        functions[f"minirocket_{count}"] = partial(_predict, rocket, traces[0])
    timings = interleaved(functions, ROUNDS, warm_up=3)
    best = min(timing.median for name, timing in timings.items() if name != "hapticnet")
    return {
        "minirocket_over_hapticnet_ratio": best / timings["hapticnet"].median,
        "target_ratio": 10.0,
        "real_traces": REAL.is_dir(),
        "threads": threads,
        **{f"{name}_ms": timing.median for name, timing in timings.items()},
        **{f"{name}_p95_ms": timing.p95 for name, timing in timings.items()},
    }


def _traces() -> tuple[list[str], list[Trace]]:
    """Label and samples of every trace to fit on, (1, samples) each, equally long."""
    samples = round(SECONDS * RATE)
    if REAL.is_dir():
        files = [
            path
            for folder in sorted(REAL.iterdir())
            if folder.is_dir()
            for path in sorted((folder / "haptic").iterdir())[:RECORDINGS]
        ]
        decoded = [SignalDecoder().decode(path)[0] for path in files]
        return [path.parts[-3] for path in files], [trace[:, :samples] for trace in decoded]
    labels, traces = [], []
    for material in make_materials(CLASSES, seed=0):
        specimen = Specimen(material)
        for recording in range(RECORDINGS):
            labels.append(material.name)
            rng = np.random.default_rng(recording)
            traces.append(slide_tool(specimen, rng, SECONDS, RATE)[:1])
    return labels, traces


def _hapticnet(labels: list[str], traces: list[Trace]) -> SurfaceClassifier:
    """The default HapticNet as prediction runs it, its features fitted on the traces."""
    config = configured("model=haptic")
    classifier = SurfaceClassifier(configured_card(config, sorted(set(labels)))).eval()
    features: Any = classifier.senses["haptic"].features
    features.fit([features.magnitudes(torch.from_numpy(trace)) for trace in traces])
    return accelerate(classifier, config.engine)


def _minirocket(labels: list[str], traces: list[Trace], threads: int) -> Any:  # noqa: ANN401
    try:
        from aeon.classification.convolution_based import MiniRocketClassifier
    except ImportError as error:
        raise UserError('MiniRocket needs aeon; pip install ".[baselines]".') from error
    rocket = MiniRocketClassifier(n_jobs=threads, random_state=0)
    rocket.fit(np.stack([_standardised(trace) for trace in traces]), np.array(labels))
    return rocket


def _predict(rocket: Any, trace: Trace) -> str:  # noqa: ANN401
    label: str = rocket.predict(_standardised(trace)[None])[0]
    return label


def _standardised(trace: Trace) -> Trace:
    return (trace - trace.mean()) / trace.std()
