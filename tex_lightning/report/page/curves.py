"""Curves over epochs, from the CSV of metrics that every training leaves."""

import csv
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

METRICS = {
    "train/loss": "training loss",
    "train/fragment_accuracy": "fragment accuracy in training",
    "val/loss": "validation loss",
    "val/vote_accuracy": "validation votes",
}


@dataclass(frozen=True)
class Curve:
    """One metric of one network.

    Attributes:
        network: Its name.
        metric: In words.
        values: One for each epoch, a mean over its steps; of several folds the first one's.
    """

    network: str
    metric: str
    values: list[float]


def read_curves(directory: Path) -> list[Curve]:
    """The curves of a run; of a cross-validation those of its first fold."""
    own = sorted(directory.glob("metrics/*/metrics.csv"))
    folds = sorted(directory.glob("folds/*/metrics/*/metrics.csv"))
    first = [path for path in folds if path.parts[-4] == folds[0].parts[-4]]
    found = [curve for path in [*own, *first] if path.is_file() for curve in _curves(path)]
    return [curve for curve in found if len(curve.values) > 1]


def _curves(path: Path) -> list[Curve]:
    values: dict[str, dict[int, list[float]]] = defaultdict(lambda: defaultdict(list))
    with path.open(newline="", encoding="utf-8") as stream:
        for line in csv.DictReader(stream):
            for key in METRICS:
                if line.get(key) and line.get("epoch"):
                    values[key][int(line["epoch"])].append(float(line[key]))
    return [
        Curve(path.parent.name, METRICS[key], [fmean(steps) for _, steps in sorted(epochs.items())])
        for key, epochs in values.items()
    ]
