"""Classify samples of the store, one at a time."""

import math
import time
from collections.abc import Sequence

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import Vote
from tex_lightning.core.devices import synchronise
from tex_lightning.core.progress import track
from tex_lightning.data.folds import Sample
from tex_lightning.data.store import Store, load_sample
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.text import to_json

WARM_UP = 2
NOT_TRAINED = -1  # index of a class that is none of the classifier's


def classify_sample(
    classifier: SurfaceClassifier, sample: Sample, store: Store
) -> tuple[Vote, float]:
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
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    store: Store,
    fold: int | None = None,
) -> list[Outcome]:
    """Classify every sample of a fold, one at a time."""
    classes = classifier.card.classes
    index = {name: number for number, name in enumerate(classes)}
    for sample in samples[:WARM_UP]:
        classify_sample(classifier, sample, store)
    outcomes = []
    for sample in track(samples, "Testing"):
        vote, latency = classify_sample(classifier, sample, store)
        truth = index.get(sample.label, NOT_TRAINED)
        outcomes.append(
            Outcome(
                files={name: row.source for name, row in sample.recordings.items()},
                label=sample.label,
                predicted=classes[vote.label],
                share=float(vote.shares[vote.label]),
                fragments=len(vote.fragments),
                correct_fragments=int((vote.fragments == truth).sum()),
                latency_ms=latency,
                votes=_votes(vote, classes),
                relative_macs=vote.relative_macs,
                probabilities=to_json(dict(zip(classes, vote.probabilities.tolist(), strict=True))),
                novelty=math.nan if vote.novelty is None else vote.novelty,
                group=" ".join({str(row.group): None for row in sample.recordings.values()}),
                fold="" if fold is None else str(fold),
            )
        )
    return outcomes


def _votes(vote: Vote, classes: list[str]) -> str:
    counts = vote.fragments.bincount(minlength=len(classes)).tolist()
    return to_json({name: n for name, n in zip(classes, counts, strict=True) if n})
