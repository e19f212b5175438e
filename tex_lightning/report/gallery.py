"""Collect the artifacts of a run for its loggers: figures, samples, texts and embeddings."""

import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.core.devices import computing_threads
from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store, load_recording
from tex_lightning.evaluation.confusion import Pair, confused_pairs, own_pairs
from tex_lightning.evaluation.outcomes import Outcome, read_outcomes
from tex_lightning.report.artifacts import Picture, Points, Sound, Words, jpeg
from tex_lightning.report.pictures import captioned, recording_picture
from tex_lightning.report.samples import ShownSample, sample_picture, worst
from tex_lightning.report.table import facts, markdown, typed_overrides
from tex_lightning.text import printable, to_markdown

WORST = 6  # samples, as far as there are errors
MIN_SHOWN = 3  # of which those that are right are the least sure
PAIRS = 3
# Tags of the figures that a test draws, by the end of their file's name.
FIGURES = {
    "confusion": "confusion/recordings",
    "confusion_fragments": "confusion/fragments",
    "classes": "histogram/fragment accuracy by class",
    "pairs": "pairs/most confused",
    "calibration": "reliability/recordings",
}


def figure_artifacts(directory: Path, network: str) -> Iterator[Picture]:
    """Yield the figures of a network in the run folder, as they were saved."""
    for file in sorted((directory / "figures").glob(f"{network}_*.png")):
        name = file.stem.removeprefix(f"{network}_")
        yield Picture(FIGURES.get(name, f"figures/{name}"), file.read_bytes())


def text_artifacts(
    directory: Path, results: Mapping[str, Any], data: Mapping[str, str]
) -> Iterator[Words]:
    """Yield the command of a run, what its data are and its results."""
    command = shlex.join(["python", "-m", "tex_lightning", *typed_overrides(directory)])
    yield Words("1 command", f"    {printable(command)}")
    yield Words("2 data", _table([["data", ""], *map(list, data.items())]))
    shown = facts(results)
    rows = {fact: None for network in shown.values() for fact in network}
    cells = [[fact, *(network.get(fact, "") for network in shown.values())] for fact in rows]
    yield Words("3 results", _table([["", *shown], *cells]))


def _table(rows: list[list[str]]) -> str:
    first, *others = [[to_markdown(cell) for cell in row] for row in rows]
    return "\n".join(markdown(first, others))


def sample_artifacts(
    look: Callable[[int], ShownSample], outcomes: Sequence[Outcome], classes: Sequence[str]
) -> Iterator[Picture | Sound]:
    """Yield the worst samples, and both sides of the most confused pairs with their sounds."""
    errors = sum(outcome.label != outcome.predicted for outcome in outcomes)
    for place, number in enumerate(worst(outcomes, min(WORST, max(errors, MIN_SHOWN))), 1):
        sample = look(number)
        yield Picture(
            f"worst samples/{place} {printable(sample.title)}", jpeg(sample_picture(sample))
        )
    for place, pair in enumerate(confused_pairs(outcomes, classes)[:PAIRS], 1):
        sides = [look(number) for number in sides_of(outcomes, pair)]
        title = printable(f"{place} {pair.label} called {pair.predicted}")
        pictures = [sample_picture(side) for side in sides]
        said = f"{pair.share:.0%} of the fragments of {pair.label} are called {pair.predicted}"
        yield Picture(f"confused pairs/{title}", jpeg(captioned([(said, pictures)])))
        for side in sides:
            for name, sense in side.senses.items():
                if sense.sound is not None:
                    tag = f"confused pairs/{title}: {name} of {printable(side.outcome.label)}"
                    yield Sound(tag, *sense.sound)


def sides_of(outcomes: Sequence[Outcome], pair: Pair) -> list[int]:
    """Return the numbers of the samples of both classes of a pair that are most for its second."""

    def likely(number: int) -> tuple[bool, float]:
        outcome = outcomes[number]
        return (
            outcome.predicted == pair.predicted,
            outcome.class_probabilities.get(pair.predicted, 0.0),
        )

    of_class = (
        [number for number, outcome in enumerate(outcomes) if outcome.label == label]
        for label in (pair.label, pair.predicted)
    )
    return [max(numbers, key=likely) for numbers in of_class if numbers]


def pair_artifacts(
    directory: Path, networks: Iterable[str], classes: Sequence[str]
) -> Iterator[Words]:
    """Yield a table of the pairs that one network confuses and another one tells apart."""
    files = {name: directory / "predictions" / f"{name}.csv" for name in networks}
    outcomes = {name: read_outcomes(file) for name, file in files.items() if file.is_file()}
    rows = [
        [own.network, own.pair.label, own.pair.predicted, f"{own.pair.share:.0%}",
         ", ".join(f"{name} {share:.0%}" for name, share in own.others.items())]
        for own in own_pairs(outcomes, classes)
    ]  # fmt: skip
    if rows:
        heading = ["network", "fragments of", "called", "share", "share of other networks"]
        yield Words("4 confused pairs", _table([heading, *rows]))


MAX_POINTS = 300  # recordings of each part, evenly chosen
MAX_DIMENSIONS = 256  # beyond which they are projected to as many principal components
SIDE = 48  # pixels of a thumbnail


class _Point(NamedTuple):
    row: Recording
    part: str
    predicted: str
    vector: Tensor


def projector_artifacts(
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    outcomes: Sequence[Outcome],
    store: Store,
) -> Iterator[Points]:
    """Yield mean embeddings of each sense for TensorBoard's projector, of training and test.

    Those of the training are at hand only directly after it.
    """
    for name, sense in classifier.senses.items():
        if classifier.statistics_of(name) is None:
            continue
        points = [*_trained(classifier, name), *_tested(classifier, name, samples, outcomes, store)]
        vectors = torch.stack([point.vector for point in points]).float()
        rows = [point.row for point in points]
        rate = getattr(sense.decoder, "sampling_rate", None)
        yield Points(
            name,
            _reduced(vectors).numpy(),
            {
                "label": [printable(row.label) for row in rows],
                "predicted": [printable(point.predicted) for point in points],
                "part": [point.part for point in points],
                "file": [printable(row.path.name) for row in rows],
            },
            np.stack([recording_picture(store.load(row), rate, (SIDE, SIDE)) for row in rows]),
        )


def _trained(classifier: SurfaceClassifier, name: str) -> Iterator[_Point]:
    rows, vectors = classifier.trained_embeddings.get(name, ((), torch.empty(0)))
    for index in _some(len(rows)):
        yield _Point(rows[index], "training", "", vectors[index])


@torch.inference_mode()
def _tested(
    classifier: SurfaceClassifier,
    name: str,
    samples: Sequence[Sample],
    outcomes: Sequence[Outcome],
    store: Store,
) -> Iterator[_Point]:
    modality = classifier.senses[name].modality
    tested = {
        sample.recordings[modality]: outcome.predicted
        for sample, outcome in zip(samples, outcomes, strict=True)
    }
    rows = [*tested]
    for index in _some(len(rows)):
        recording = load_recording(rows[index], store)
        with computing_threads(classifier.threads(name, recording)):
            vector = classifier.embedding(name, recording.to(classifier.device)).mean(dim=1).cpu()
        yield _Point(rows[index], "test", tested[rows[index]], vector)


def _some(count: int) -> list[int]:
    """Return the numbers of at most so many as are shown, evenly chosen."""
    chosen = np.linspace(0, count - 1, min(count, MAX_POINTS)).round().astype(int)
    return [int(index) for index in chosen]


def _reduced(vectors: Tensor) -> Tensor:
    """Project vectors (n, D) of many dimensions to their principal components."""
    if vectors.shape[1] <= MAX_DIMENSIONS:
        return vectors
    centred = vectors - vectors.mean(dim=0)
    _, _, components = torch.linalg.svd(centred, full_matrices=False)
    projected: Tensor = centred @ components[:MAX_DIMENSIONS].mT
    return projected
