"""What a process that runs for long keeps: memory and times at its beginning and at its end.

``python -m benchmarks longrun``, or shorter ``python -m benchmarks.longrun --predictions 2000
--jobs 20 --hours 0.2``. The networks are narrow and their weights random: what is kept does not
depend on that.

- predictions: one trace after another through the Python interface.
- jobs: one Hydra sweep of the basic launcher over as many seeds, each the smallest training.
- stream: hours of signal in chunks of a second. The signal repeats itself, so that the fragments of
  a trace of a few periods tell what every fragment of the stream has to be.

Times are of the processor, except those of jobs. Memory is the resident set without pages of
files, at a hundredth of the way, where all has been loaded and allocated, and at the end.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import torch

from benchmarks._classifiers import configured, make_classifier
from benchmarks._process import resident, run_watched
from tex_lightning.decision.voting import Vote, probabilities
from tex_lightning.inference.streaming.live import WholeVote
from tex_lightning.memory import kept_memory
from tex_lightning.predictor import Predictor

PREDICTIONS, JOBS, HOURS = 100_000, 1000, 24.0
RATE, SECONDS = 10_000, 2.2  # of a trace; a little more than one fragment
NETWORK = ("model=haptic", "model.haptic.width=0.1", "trainer.accelerator=cpu")
PERIOD = 48  # seconds after which the signal of the stream repeats itself
STEP = 1600  # samples from one fragment to the next, which a period holds a whole number of
SMALLEST = (
    *NETWORK, "data=folder", "data.folds=2", "data.val_fold=null", "model.haptic.fit.epochs=1",
    "model.haptic.fit.steps_per_epoch=1", "model.haptic.fit.batch_size=2", "explained_samples=0",
)  # fmt: skip


def measure(
    predictions: int = PREDICTIONS, jobs: int = JOBS, hours: float = HOURS
) -> dict[str, Any]:
    """Memory and times of all three."""
    with kept_memory():  # as every task does
        return {
            "predictions": predict(predictions),
            "stream": stream(hours),
            "jobs": sweep(jobs),
        }


def predict(number: int) -> dict[str, float]:
    """So many predictions in this process."""
    model = Predictor(make_classifier(*NETWORK), configured(*NETWORK))
    rng = np.random.default_rng(0)
    traces = [rng.standard_normal(round(SECONDS * RATE)).astype(np.float32) for _ in range(50)]
    memory, spent = {}, np.empty(number)
    for at in range(number):
        begin = time.process_time()
        model.predict(haptic=traces[at % len(traces)])
        spent[at] = time.process_time() - begin
        if at + 1 in (number // 100, number):
            memory[at + 1] = own_memory()
    return _summary(memory, spent)


def stream(hours: float) -> dict[str, Any]:
    """So many hours of signal, pushed a second at a time."""
    classifier, (period, three) = make_classifier(*NETWORK), _signal()
    with torch.inference_mode():  # no class wins every fragment
        scores = classifier.logits(haptic=three)
        classifier.network.head.score_layer.bias.sub_(scores.mean(dim=1))
        known = classifier.logits(haptic=three)
    live = Predictor(classifier, configured(*NETWORK)).stream()
    number = max(4, round(3600 * hours / PERIOD)) * PERIOD
    memory, spent, apart = {}, np.empty(number), {}
    for at in range(number):
        begin = time.process_time()
        live.push(period[at % PERIOD])
        spent[at] = time.process_time() - begin
        if at + 1 in (number // 100, number):
            memory[at + 1] = own_memory()
        if (at + 1) % PERIOD == 0 and (at + 1) // PERIOD in _points(number // PERIOD):
            vote = cast(WholeVote, live.classifier).push({})
            assert vote is not None
            apart[at + 1] = _apart(vote, known, (at + 1) // PERIOD)
    return {
        **_summary(memory, spent),
        "fragments": len(vote.fragments),
        "fragments_unlike_predict": max(unlike for unlike, _ in apart.values()),
        "probability_from_predict": {f"at {at} s": far for at, (_, far) in apart.items()},
    }


def _signal() -> tuple[npt.NDArray[np.float32], torch.Tensor]:
    """Seconds (PERIOD, samples) of noise of changing colour, and three of these periods (1, T)."""
    rng = np.random.default_rng(0)
    at = np.arange(PERIOD * RATE) / RATE
    tone = np.sin(2 * np.pi * (200 + 30 * np.sin(2 * np.pi * at / 7)) * at)
    samples = rng.standard_normal(len(at)) * (1 + np.sin(9 * at)) + tone
    period = samples.astype(np.float32)
    return period.reshape(PERIOD, RATE), torch.from_numpy(np.tile(period, 3)[None])


def _points(periods: int) -> set[int]:
    return {max(4, periods // share) for share in (100, 4, 2, 1)}


def _apart(vote: Vote, scores: torch.Tensor, periods: int) -> tuple[int, float]:
    """Fragments that are not those of ``predict``, and how far probabilities are from its own.

    Args:
        vote: Of a stream of so many periods.
        scores: (classes, fragments) of three periods: the first, one between others, the last.
        periods: Three or more.
    """
    single = round(PERIOD * RATE / STEP)
    first, middle, last = scores.split([single, single, scores.shape[1] - 2 * single], dim=1)
    labels = [each.argmax(dim=0) for each in (first, middle, last)]
    expected = torch.cat([labels[0], labels[1].repeat(periods - 2), labels[2]])
    sums = probabilities(first) + (periods - 2) * probabilities(middle) + probabilities(last)
    far = (vote.probabilities - sums / len(expected)).abs().max()
    return int((vote.fragments != expected).sum()), float(far)


def sweep(jobs: int) -> dict[str, float]:
    """One sweep of so many jobs in one process."""
    with tempfile.TemporaryDirectory() as folder:
        root, rng = Path(folder), np.random.default_rng(0)
        for name in ("a", "b"):
            (root / "data" / name / "haptic").mkdir(parents=True)
            for number in range(2):
                trace = rng.standard_normal(round(SECONDS * RATE)).astype(np.float32)
                np.save(root / "data" / name / "haptic" / f"{number}.npy", trace)
        watched = run_watched(
            [sys.executable, "-m", "tex_lightning", "-m", f"seed=range({jobs})", *SMALLEST,
             f"data.root={root}/data", f"data.cache_dir={root}/cache",
             f"hydra.sweep.dir={root}/sweep"]
        )  # fmt: skip
        ends = [(root / "sweep" / str(job) / "results.json").stat().st_mtime for job in range(jobs)]
    ended = watched["history"][-1][0]
    memory = {
        job + 1: max(own for at, own in watched["history"] if at <= ends[job])
        for job in (max(1, jobs // 100), jobs - 1)
    }
    return {**_summary(memory, np.diff(ends)), "summary_s": ended - ends[-1]}


def own_memory() -> float:
    """Resident set of this process without pages of files, in MiB."""
    size, of_files = resident()
    return size - of_files


def _summary(memory: dict[int, float], spent: npt.NDArray[np.float64]) -> dict[str, float]:
    tenth = max(1, len(spent) // 10)
    return {
        "number": len(spent),
        **{f"mib_after_{at}": size for at, size in memory.items()},
        "median_ms": 1000 * float(np.median(spent)),
        "p99_ms": 1000 * float(np.quantile(spent, 0.99)),
        "last_to_first_tenth_ratio": float(np.median(spent[-tenth:]) / np.median(spent[:tenth])),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--predictions", type=int, default=PREDICTIONS)
    parser.add_argument("--jobs", type=int, default=JOBS)
    parser.add_argument("--hours", type=float, default=HOURS)
    print(json.dumps(measure(**vars(parser.parse_args())), indent=1))


if __name__ == "__main__":
    main()
