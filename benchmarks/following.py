"""How soon the label of a live stream is the new one when the tool moves to another surface.

``python -m benchmarks following``. A fold is trained; of its test recordings two of different
classes are joined, with no gap, and streamed in chunks of 0.1 s, whose time is the processor's. It
needs the recordings of ``shared/data/lmt16`` beside the checkout.
"""

import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch

import tex_lightning as tl
from benchmarks.peers import REAL
from tex_lightning.data.decode import SignalDecoder, Trace
from tex_lightning.errors import UserError
from tex_lightning.predictor import Predictor

MODELS = {"few/haptic": "experiment=few/haptic", "haptic": "model=haptic"}
WINDOWS = {
    "whole": ["stream.window=60", "stream.odds=null"],  # more than there is
    "1 s": ["stream.window=1", "stream.odds=null"],
    "1 s, changes": ["stream.window=1"],
    "2 s": ["stream.window=2", "stream.odds=null"],
    "2 s, changes": ["stream.window=2"],
}
FOLD = 0
PAIRS = 60
CHUNK = 0.1
STEADY = 1.5  # s after which a part of the stream should have its label


def measure() -> dict[str, Any]:
    """By model and window; seconds to the new label end with the recording where it never comes."""
    if not REAL.is_dir():
        raise UserError(f"There are no recordings in {REAL}; put lmt16 there.")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with TemporaryDirectory() as folder:
            return {name: _of_model(name, Path(folder)) for name in MODELS}
    finally:
        torch.set_num_threads(threads)


def _of_model(name: str, folder: Path) -> dict[str, Any]:
    run = folder / name.replace("/", "_")
    data = ["data=folder", f"data.root={REAL}", f"data.test_fold={FOLD}"]
    tl.train(MODELS[name], *data, f"hydra.run.dir={run}")
    return {window: of_window(run, keys) for window, keys in WINDOWS.items()}


def of_window(run: Path, keys: list[str], pairs: int = PAIRS, fold: int = FOLD) -> dict[str, float]:
    """Stream pairs of the recordings of one fold."""
    model = tl.load(run, *keys)
    traces = [_trace(name, fold) for name in model.card.classes]
    rng = np.random.default_rng(0)
    found = []
    for _ in range(pairs):
        first, second = rng.choice(len(traces), 2, replace=False)
        names = [model.card.classes[first], model.card.classes[second]]
        found.append(_follow(model, names, [traces[first], traces[second]]))
    reached, delays, right, changes, minutes, spent = (
        np.concatenate([np.atleast_1d(each[part]) for each in found]) for part in range(6)
    )
    return {
        "first_median_s": float(np.median(reached)),
        "first_p90_s": float(np.quantile(reached, 0.9, method="higher")),
        "follow_median_s": float(np.median(delays)),
        "follow_p90_s": float(np.quantile(delays, 0.9, method="higher")),
        "steady_accuracy": float(right.mean()),
        "false_changes_per_minute": float(changes.sum() / minutes.sum()),
        "chunk_cpu_median_ms": 1000 * float(np.median(spent)),
        "chunk_cpu_p99_ms": 1000 * float(np.quantile(spent, 0.99)),
    }


def _follow(model: Predictor, names: list[str], traces: list[Trace]) -> tuple[Any, ...]:
    """Seconds to the first new label and until it stays, and for each chunk what is told."""
    stream, labels, changed, spent = model.stream(), [], [], []
    size = round(CHUNK * stream.rate)
    joined = np.concatenate(traces, axis=1)
    for begin in range(0, joined.shape[1] - size + 1, size):
        start = time.process_time()
        said = stream.push(joined[:, begin : begin + size])
        spent.append(time.process_time() - start)
        labels.append(said.label)
        changed.append(said.changed_at)
    ends = CHUNK * np.arange(1, len(labels) + 1)
    border, length = (each.shape[1] / stream.rate for each in (traces[0], joined))
    new = np.array(labels) == names[1]
    first = ends[(ends > border) & new].min(initial=length)
    settled = ends[(ends > border) & ~new].max(initial=border) + CHUNK
    steady = (ends > STEADY) & (ends <= border) | (ends > border + STEADY)
    expected = np.where(ends <= border, *names)
    false = [now != was for was, now in zip([None, *changed], changed, strict=False)] & steady
    right = (np.array(labels) == expected)[steady]
    minutes = steady.sum() * CHUNK / 60
    return first - border, min(settled, length) - border, right, false, minutes, spent


def _trace(name: str, fold: int) -> Trace:
    files = sorted((REAL / name / "haptic").iterdir())
    return SignalDecoder().decode(files[fold])[0]
