"""How the time of every step between files and report grows with classes and with recordings.

``python -m benchmarks growth``, or of another size ``python -m benchmarks.growth --classes 200
--recordings 20``. Tables of two senses and outcomes of one fold are made up in memory; nothing is
decoded or trained. Each step is timed at a quarter, a half and all of the classes with all
recordings of each, and the same of the recordings with all classes. Its exponent is the slope of
log time over log size: 1 where twice the data take twice the time. Scores of a fragment have an
entry for each class and confusion matrices one for each pair of them, so that votes and these
matrices grow with 2 in the classes where each class has as many recordings.
At last a narrow HapticNet is trained and tested on a hundredth and on a tenth as many short traces.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks._classifiers import configured
from benchmarks._process import run_watched
from tex_lightning.data.banks import InputBank
from tex_lightning.data.conditions import check_conditions
from tex_lightning.data.datamodule import TrainingBatches
from tex_lightning.data.folds import check_split, make_samples, split
from tex_lightning.data.recordings import Recording, Recordings, read_manifest, write_manifest
from tex_lightning.decision.voting import max_vote
from tex_lightning.evaluation.calibration import calibration
from tex_lightning.evaluation.conditions import by_condition
from tex_lightning.evaluation.fragments import confused_pairs, fragment_counts, vote_counts
from tex_lightning.evaluation.mcnemar import mcnemar
from tex_lightning.evaluation.outcomes import (
    Outcome,
    read_outcomes,
    summarise,
    write_outcomes,
)
from tex_lightning.evaluation.pairing import difference
from tex_lightning.evaluation.samples import kept_probabilities
from tex_lightning.learning.statistics import left_out_novelties
from tex_lightning.networks.statistics import FeatureStatistics
from tex_lightning.report.calibration_figure import calibration_figure
from tex_lightning.report.confusion import class_accuracy_figure, confusion_figure
from tex_lightning.report.figures import save_figure
from tex_lightning.report.page.media import shown_samples
from tex_lightning.report.page.writing import write_page
from tex_lightning.runs.explained import telling

CLASSES, RECORDINGS, FOLDS = 1000, 100, 10
SENSES = ("haptic", "image")
SHARES = (4, 2, 1)  # of the full size
DIMENSIONS = 32  # of the features whose statistics are taken
TRAINED = 50  # classes of the traces that are trained on
RATE, SECONDS = 2000, 2.0  # of these traces: hardly more than a fragment
LEAST = 0.005  # seconds, below which a time says nothing of growth
FRAGMENTS = 20  # of a sample
BATCHES = 200  # of training


@dataclass
class Simulated:
    """A table of recordings and what became of the samples of one fold.

    Attributes:
        classes: Their number.
        recordings: Of each class and sense.
        folder: For what is written.
    """

    classes: int
    recordings: int
    folder: Path

    @cached_property
    def names(self) -> list[str]:
        return [f"material {number}" for number in range(self.classes)]

    @cached_property
    def table(self) -> Recordings:
        """Two senses; files that need not be there."""
        return Recordings(
            tuple(
                Recording(
                    name, sense, self.folder / f"{sense}_{at}_{number}", number,
                    conditions=(("speed", str(number % 5)),),
                )
                for sense in SENSES
                for at, name in enumerate(self.names)
                for number in range(self.recordings)
            )
        )  # fmt: skip

    @cached_property
    def data(self) -> Any:  # noqa: ANN401
        return configured("data=folder", "data.root=none").data

    @cached_property
    def outcomes(self) -> list[Outcome]:
        """Of one fold; nine of ten are correct, and probabilities are those of noise."""
        rng = np.random.default_rng(0)
        found = []
        for sample in make_samples(split(self.table, self.data).test, SENSES):
            wrong = rng.random() < 0.1
            predicted = self.names[rng.integers(self.classes)] if wrong else sample.label
            drawn = rng.exponential(size=self.classes)
            known = torch.from_numpy(drawn / drawn.sum())
            truth, won = self.names.index(sample.label), self.names.index(predicted)
            votes = {predicted: FRAGMENTS - 1, self.names[rng.integers(self.classes)]: 1}
            found.append(
                Outcome(
                    {name: str(row.path) for name, row in sample.recordings.items()},
                    sample.label, predicted, 0.9, FRAGMENTS, FRAGMENTS - 1, 1.0,
                    json.dumps(votes), novelty=0.5,
                    probabilities=kept_probabilities(known, self.names, {truth, won}),
                )
            )  # fmt: skip
        return found

    @cached_property
    def labels(self) -> Any:  # noqa: ANN401
        return np.repeat(np.arange(self.classes), self.recordings)


def measure(classes: int = CLASSES, recordings: int = RECORDINGS) -> dict[str, Any]:
    """By step: seconds at the full size, and the exponents in classes and in recordings."""
    series = {
        "classes": [(classes // share, recordings) for share in SHARES],
        "recordings": [(classes, recordings // share) for share in SHARES],
    }
    seconds = {size: _times(*size) for sizes in series.values() for size in sizes}
    steps = seconds[classes, recordings]
    exponents = {
        step: {
            "seconds": steps[step],
            **{
                f"exponent_in_{name}": exponent(
                    [np.prod(size) for size in sizes], [seconds[size][step] for size in sizes]
                )
                for name, sizes in series.items()
            },
        }
        for step in steps
    }
    sizes = {max(10 * TRAINED, classes * recordings // share) for share in (100, 10)}
    memory = {f"{each} recordings": training_memory(each) for each in sorted(sizes)}
    return {**exponents, "memory of training": memory}


def training_memory(recordings: int) -> dict[str, float]:
    """Peak memory in MiB of training and testing a narrow HapticNet on so many short traces."""
    with tempfile.TemporaryDirectory() as folder:
        root, rng = Path(folder) / "data", np.random.default_rng(0)
        for number in range(recordings):
            path = root / f"c{number % TRAINED}" / "haptic" / f"{number:06d}.npy"
            path.parent.mkdir(parents=True, exist_ok=True)
            np.save(path, rng.standard_normal(round(SECONDS * RATE)).astype(np.float32))
        found = run_watched(
            [sys.executable, "-m", "tex_lightning", "model=haptic", "model.haptic.width=0.1",
             *(f"model.haptic.fit.{key}" for key in ("epochs=1", "steps_per_epoch=9")),
             "data=folder", f"data.root={root}", f"data.sampling_rate={RATE}",
             f"data.cache_dir={folder}/cache", f"hydra.run.dir={folder}/run",
             "explained_samples=0"]
        )  # fmt: skip
    return {key: found[key] for key in ("peak_mib", "peak_own_mib", "seconds")}


def exponent(sizes: list[int], seconds: list[float]) -> float | None:
    """Slope of log time over log size; None of what takes hardly any time."""
    if seconds[-1] < LEAST:
        return None
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def _times(classes: int, recordings: int) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        simulated = Simulated(classes, recordings, Path(folder))
        return {name: _timed(step, simulated) for name, step in STEPS.items()}


def _timed(step: Callable[[Simulated], Callable[[], object]], simulated: Simulated) -> float:
    """Seconds of processor time, without what the step is given."""
    run = step(simulated)
    begin = time.process_time()
    run()
    return time.process_time() - begin


def _of_table(function: Callable[[Simulated, Recordings], object]) -> Any:  # noqa: ANN401
    def step(given: Simulated) -> Callable[[], object]:
        table = given.table
        return lambda: function(given, table)

    return step


def _of_outcomes(function: Callable[[Simulated, list[Outcome]], object]) -> Any:  # noqa: ANN401
    def step(given: Simulated) -> Callable[[], object]:
        outcomes = given.outcomes
        return lambda: function(given, outcomes)

    return step


def _manifest(given: Simulated) -> Callable[[], object]:
    for row in given.table:
        row.path.touch()
    path = given.folder / "manifest.csv"

    def run() -> None:
        write_manifest(given.table, path)
        read_manifest(path)

    return run


def _batches(given: Simulated) -> Callable[[], object]:
    bank = InputBank([torch.zeros(1, 1, 2)] * len(given.labels), 2)
    banks = dict.fromkeys(SENSES, (bank, given.labels))
    batches = TrainingBatches(banks, 64, 0)
    return lambda: [batches[step] for step in range(BATCHES)]


def _features(given: Simulated) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    return torch.randn(len(given.labels), DIMENSIONS, generator=generator), torch.from_numpy(
        given.labels
    )


def _statistics(given: Simulated) -> Callable[[], object]:
    features, labels = _features(given)
    return lambda: FeatureStatistics.of(features, labels, given.classes)


def _left_out(given: Simulated) -> Callable[[], object]:
    features, labels = _features(given)
    groups = [str(number) for number in range(len(labels))]
    return lambda: left_out_novelties(features, labels, given.classes, groups)


def _votes(given: Simulated) -> Callable[[], object]:
    scores = torch.randn(given.classes, FRAGMENTS)
    count = given.classes * given.recordings // FOLDS
    return lambda: [max_vote(scores) for _ in range(count)]


def _counts(given: Simulated) -> Any:  # noqa: ANN401
    return vote_counts(given.outcomes, given.names)


def _confusion(given: Simulated) -> Callable[[], object]:
    counts, path = _counts(given), given.folder / "confusion"
    return lambda: save_figure(confusion_figure(counts, given.names, "votes"), path, ("png",))


def _bars(given: Simulated) -> Callable[[], object]:
    counts, path = _counts(given), given.folder / "bars"
    return lambda: save_figure(
        class_accuracy_figure(counts, given.names, "fusion", "votes"), path, ("png",)
    )


def _reliability(given: Simulated) -> Callable[[], object]:
    outcomes, path = given.outcomes, given.folder / "calibration"
    return lambda: save_figure(calibration_figure(outcomes, "votes"), path, ("png",))


def _paired(given: Simulated, outcomes: list[Outcome]) -> object:
    return difference(outcomes, outcomes)


def _mcnemar(given: Simulated, outcomes: list[Outcome]) -> object:
    known = {each.sample: each.label == each.predicted for each in outcomes}
    return mcnemar(known, {name: not value for name, value in known.items()})


def _tested(given: Simulated) -> Callable[[], object]:
    samples, outcomes = make_samples(split(given.table, given.data).test, SENSES), given.outcomes
    return lambda: by_condition(samples, outcomes)


def _files(given: Simulated, outcomes: list[Outcome]) -> None:
    path = given.folder / "predictions" / "fusion.csv"
    write_outcomes(outcomes, path)
    read_outcomes(path)


def _pairs(given: Simulated, outcomes: list[Outcome]) -> object:
    counts = fragment_counts(outcomes, given.names)
    return confused_pairs({"haptic": counts, "visual": counts.T}, given.names)


def _page(given: Simulated) -> Callable[[], object]:
    results = {
        "task": "fit", "classes": given.names,
        "networks": {"fusion": {**summarise(given.outcomes), "parameters": 1, "macs_per_sample": 1,
                                "fit_seconds": 1.0}},
    }  # fmt: skip
    (given.folder / "results.json").write_text(json.dumps(results))
    write_outcomes(given.outcomes, given.folder / "predictions" / "fusion.csv")
    return lambda: write_page(given.folder, "command")


STEPS: dict[str, Callable[[Simulated], Callable[[], object]]] = {
    "classes in natural order": _of_table(lambda given, table: table.classes),
    "division into folds": _of_table(lambda given, table: split(table, given.data)),
    "check of the folds": _of_table(
        lambda given, table: check_split(split(table, given.data), given.names, SENSES, given.data)
    ),
    "conditions": _of_table(lambda given, table: check_conditions(table, {"speed": [1, 2]})),
    "samples": _of_table(lambda given, table: make_samples(table, SENSES)),
    "manifest, written and read": _manifest,
    "200 training batches": _batches,
    "votes": _votes,
    "feature statistics": _statistics,
    "left-out novelties": _left_out,
    "summary": _of_outcomes(lambda given, outcomes: summarise(outcomes)),
    "accuracy by condition": _tested,
    "calibration": _of_outcomes(lambda given, outcomes: calibration(outcomes, given.names)),
    "predictions, written and read": _of_outcomes(_files),
    "counts of votes": _of_outcomes(lambda given, outcomes: vote_counts(outcomes, given.names)),
    "confused pairs": _of_outcomes(_pairs),
    "McNemar's test": _of_outcomes(_mcnemar),
    "comparison of senses": _of_outcomes(_paired),
    "telling samples": _of_outcomes(lambda given, outcomes: telling(outcomes, 3)),
    "worst samples": lambda given: lambda: shown_samples(given.folder, ["fusion"]),
    "confusion figure": _confusion,
    "figure of all classes": _bars,
    "calibration figure": _reliability,
    "report.html": _page,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--classes", type=int, default=CLASSES)
    parser.add_argument("--recordings", type=int, default=RECORDINGS)
    print(json.dumps(measure(**vars(parser.parse_args())), indent=1))


if __name__ == "__main__":
    main()
