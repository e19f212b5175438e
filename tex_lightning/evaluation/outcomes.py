"""Test a classifier sample by sample: the table of outcomes, intervals and ``results.json``."""

import json
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # whose parts are loaded when they are used

from tex_lightning.classifier.vote import Decider, Vote
from tex_lightning.core.devices import synchronise
from tex_lightning.core.files import read_rows, write_rows
from tex_lightning.core.progress import track
from tex_lightning.core.run_folder import predictions_of
from tex_lightning.data.folds import Sample
from tex_lightning.data.store import Store, load_sample
from tex_lightning.errors import UserError
from tex_lightning.text import to_json

FILES = "files"


@dataclass(frozen=True)
class Outcome:
    """The outcome of one test sample.

    Attributes:
        files: Files of the sample by modality; a column for each in the CSV.
        label: True class.
        predicted: Class that won the vote.
        share: Share of the fragments that voted for it.
        fragments: Number of fragments.
        correct_fragments: Number of fragments that voted for the true class.
        latency_ms: Time from decoded recordings to the label.
        votes: Number of fragments for each class that has any, as JSON.
        relative_macs: Arithmetic done, as a share of what all fragments take.
        probabilities: Mean class probabilities of the fragments, as JSON.
        novelty: Novelty of the sample, from 0; NaN if not known, or not of all senses.
        group: Group of its recordings; several of different groups in one string.
        fold: Fold that was tested; empty where all recordings or some conditions were.
    """

    files: Mapping[str, str]
    label: str
    predicted: str
    share: float
    fragments: int
    correct_fragments: int
    latency_ms: float
    votes: str = "{}"
    relative_macs: float = 1.0
    probabilities: str = "{}"
    novelty: float = math.nan
    group: str = ""
    fold: str = ""

    @property
    def class_probabilities(self) -> dict[str, float]:
        """Mean probability of each class that is kept."""
        probabilities: dict[str, float] = json.loads(self.probabilities)
        return probabilities

    @property
    def correct(self) -> bool:
        """Whether the vote is for the true class."""
        return self.label == self.predicted

    @property
    def sample(self) -> str:
        """Identity of the sample: its files, sorted by modality."""
        return "|".join(self.files[modality] for modality in sorted(self.files))


def summarise(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return accuracies, Wilson interval, counts and latency of a list of outcomes.

    ``fragment_accuracy`` is the share of all fragments, as in the paper: a long recording has more
    of them and weighs more than a short one.
    """
    correct = sum(outcome.correct for outcome in outcomes)
    latencies = [outcome.latency_ms for outcome in outcomes]
    return {
        "fragment_accuracy": sum(outcome.correct_fragments for outcome in outcomes)
        / sum(outcome.fragments for outcome in outcomes),
        **counted(correct, len(outcomes)),
        "latency_ms": {
            "median": float(np.median(latencies)),
            "p95": float(np.percentile(latencies, 95)),
        },
    }


def optimized_value(results: dict[str, Any]) -> float | None:
    """Return what a search minimises, the validation loss, and never anything of the test.

    Args:
        results: Results of a training; its last network is the one that was asked for.

    Returns:
        None without a validation fold.
    """
    *_, network = results["networks"].values()  # the one that was asked for
    loss: float | None = network.get("val_loss")
    return loss


def wilson_interval(correct: int, count: int) -> list[float]:
    """Return Wilson's 95 % interval of a share."""
    interval = scipy.stats.binomtest(correct, count).proportion_ci(
        confidence_level=0.95, method="wilson"
    )
    return [float(interval.low), float(interval.high)]


def write_outcomes(outcomes: Sequence[Outcome], path: Path) -> None:
    """Write one line per test sample as CSV: its files by modality, then the rest."""
    facts = [dict(vars(outcome)) for outcome in outcomes]
    lines = [{**fact.pop(FILES), **fact} for fact in facts]
    write_rows(path, lines[0], (line.values() for line in lines))


def read_outcomes(path: Path) -> list[Outcome]:
    """Read what :func:`write_outcomes` wrote."""
    types = {entry.name: entry.type for entry in fields(Outcome) if entry.name != FILES}
    outcomes = []
    for line in read_rows(path):
        files = {name: value for name, value in line.items() if name not in types}
        columns = {name: kind for name, kind in types.items() if name in line}
        rest: dict[str, Any] = {name: kind(line[name]) for name, kind in columns.items()}  # type: ignore[operator]
        outcomes.append(Outcome(files=files, **rest))
    return outcomes


def read_networks(directory: Path, networks: Iterable[str]) -> dict[str, list[Outcome]]:
    """Return the outcomes of those networks of a run folder that it has tested."""
    files = {name: predictions_of(directory, name) for name in networks}
    return {name: read_outcomes(file) for name, file in files.items() if file.is_file()}


COUNTS = ("correct", "test_samples", "vote_accuracy", "vote_ci95")  # keys of the following


def counted(correct: int, count: int) -> dict[str, Any]:
    """Return counts of votes as an entry of ``results.json`` has them."""
    return {
        "correct": correct,
        "test_samples": count,
        "vote_accuracy": correct / count,
        "vote_ci95": wilson_interval(correct, count),
    }


WARM_UP = 2


def classify_sample(classifier: Decider, sample: Sample, store: Store) -> tuple[Vote, float]:
    """Classify one sample; the time in ms runs from decoded recordings to the label.

    Raises:
        UserError: Naming the file, if a recording cannot be used.
    """
    recordings = load_sample(sample, store)
    device = classifier.device
    synchronise(device)
    begin = time.perf_counter()
    try:
        vote = classifier.classify(**recordings)
    except UserError as error:
        files = [row.source for row in sample.recordings.values()]
        raise UserError(f"{' and '.join(files)}: {error}") from error
    synchronise(device)
    return vote, (time.perf_counter() - begin) * 1000


def run_test(
    classifier: Decider, samples: Sequence[Sample], store: Store, fold: int | None = None
) -> list[Outcome]:
    """Classify every sample of a fold, one at a time."""
    classes = classifier.card.classes
    for sample in samples[:WARM_UP]:
        classify_sample(classifier, sample, store)
    outcomes = []
    for sample in track(samples, "testing sample"):
        vote, latency = classify_sample(classifier, sample, store)
        counts = vote.fragments.bincount(minlength=len(classes)).tolist()
        votes = {name: n for name, n in zip(classes, counts, strict=True) if n}
        outcomes.append(
            Outcome(
                files={name: row.source for name, row in sample.recordings.items()},
                label=sample.label,
                predicted=classes[vote.label],
                share=float(vote.shares[vote.label]),
                fragments=len(vote.fragments),
                correct_fragments=votes.get(sample.label, 0),
                latency_ms=latency,
                votes=to_json(votes),
                relative_macs=vote.relative_macs,
                probabilities=to_json(dict(zip(classes, vote.probabilities.tolist(), strict=True))),
                novelty=math.nan if vote.novelty is None else vote.novelty,
                group=" ".join({str(row.group): None for row in sample.recordings.values()}),
                fold="" if fold is None else str(fold),
            )
        )
    return outcomes
