"""Collect the artifacts of a run for its loggers: figures, texts, samples and embeddings."""

import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.core.devices import computing_threads
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import load_recording
from tex_lightning.evaluation.confusion import own_pairs
from tex_lightning.evaluation.outcomes import read_networks
from tex_lightning.report.artifacts import Media, Points, jpeg, wav
from tex_lightning.report.data_page import data_tables
from tex_lightning.report.pictures import captioned, recording_picture
from tex_lightning.report.samples import SampleView, sample_picture, worst
from tex_lightning.report.table import Table, fact_table, markdown, typed_overrides
from tex_lightning.text import printable, to_markdown

WORST = 6  # samples, as far as there are errors
MIN_SHOWN = 3  # of which those that are right are the least sure
MAX_POINTS = 300  # recordings of each part of the projector, evenly chosen
MAX_DIMENSIONS = 256  # beyond which embeddings are projected to as many principal components
SIDE = 48  # pixels of a thumbnail
# Tags of the figures that a test draws, by the end of their file's name.
FIGURES = {
    "confusion": "confusion/recordings",
    "confusion_fragments": "confusion/fragments",
    "classes": "histogram/fragment accuracy by class",
    "calibration": "reliability/recordings",
}


def figure_artifacts(directory: Path, network: str) -> Iterator[Media]:
    """Yield the figures of a network in the run folder, as they were saved."""
    for file in sorted((directory / "figures").glob(f"{network}_*.png")):
        name = file.stem.removeprefix(f"{network}_")
        yield Media(FIGURES.get(name, f"figures/{name}"), file.read_bytes(), file.suffix)


def text_artifacts(directory: Path, results: Mapping[str, Any]) -> Iterator[Media]:
    """Yield the command of a run, what its data are and its results."""
    command = shlex.join(["python", "-m", "tex_lightning", *typed_overrides(directory)])
    yield _text("1 command", [f"    {printable(command)}"])
    yield _table("2 data", data_tables(directory)[0])
    yield _table("3 results", fact_table(results))


def _table(tag: str, table: Table) -> Media:
    first, *others = [[*map(to_markdown, row)] for row in (table.headings, *table.cells)]
    return _text(tag, markdown(first, others))


def _text(tag: str, lines: Sequence[str]) -> Media:
    return Media(tag, "\n".join(lines).encode(), ".md")


def sample_artifacts(view: SampleView) -> Iterator[Media]:
    """Yield the worst samples, and both sides of the most confused pairs with their sounds."""
    most = min(WORST, max(view.errors, MIN_SHOWN))
    for place, number in enumerate(worst(view.outcomes, most), 1):
        sample = view.look(number)
        tag = f"worst samples/{place} {printable(sample.title)}"
        yield Media(tag, jpeg(sample_picture(sample)), ".jpg")
    for place, (pair, numbers) in enumerate(view.pairs(), 1):
        sides = [view.look(number) for number in numbers]
        title = printable(f"{place} {pair.label} called {pair.predicted}")
        pictures = [sample_picture(side) for side in sides]
        said = f"{pair.share:.0%} of the fragments of {pair.label} are called {pair.predicted}"
        yield Media(f"confused pairs/{title}", jpeg(captioned([(said, pictures)])), ".jpg")
        for side in sides:
            for name, sense in side.senses.items():
                if sense.sound is not None:
                    tag = f"confused pairs/{title}: {name} of {printable(side.outcome.label)}"
                    yield Media(tag, wav(*sense.sound), ".wav")


def pair_artifacts(
    directory: Path, networks: Iterable[str], classes: Sequence[str]
) -> Iterator[Media]:
    """Yield a table of the pairs that one network confuses and another one tells apart."""
    rows = [
        {
            "network": own.network,
            "fragments of": own.pair.label,
            "called": own.pair.predicted,
            "share": f"{own.pair.share:.0%}",
            "share of other networks": ", ".join(f"{key} {x:.0%}" for key, x in own.others.items()),
        }
        for own in own_pairs(read_networks(directory, networks), classes)
    ]
    if rows:
        yield _table("4 confused pairs", Table("", rows))


Point = tuple[Recording, str, str, Tensor]  # with its part, label and mean embedding


def projector_artifacts(classifier: SurfaceClassifier, view: SampleView) -> Iterator[Points]:
    """Yield the embeddings of each sense: those of training that are at hand, and of the test."""
    for name, sense in classifier.senses.items():
        if classifier.statistics_of(name) is None:
            continue
        points = *_trained(classifier, name), *_tested(classifier, name, view)
        rows, parts, labels, vectors = zip(*points, strict=True)
        rate = getattr(sense.decoder, "sampling_rate", None)
        yield Points(
            name,
            _reduced(torch.stack(vectors).float()).numpy(),
            {
                "label": [printable(row.label) for row in rows],
                "predicted": [*map(printable, labels)],
                "part": parts,
                "file": [printable(row.path.name) for row in rows],
            },
            np.stack([recording_picture(view.store.load(row), rate, (SIDE, SIDE)) for row in rows]),
        )


def _trained(classifier: SurfaceClassifier, name: str) -> Iterator[Point]:
    rows, vectors = classifier.trained_embeddings.get(name, ((), torch.empty(0)))
    for index in _some(len(rows)):
        yield rows[index], "training", "", vectors[index]


@torch.inference_mode()
def _tested(classifier: SurfaceClassifier, name: str, view: SampleView) -> Iterator[Point]:
    modality = classifier.senses[name].modality
    tested = {
        sample.recordings[modality]: outcome.predicted
        for sample, outcome in zip(view.samples, view.outcomes, strict=True)
    }
    rows = [*tested]
    for index in _some(len(rows)):
        recording = load_recording(rows[index], view.store)
        with computing_threads(classifier.threads(name, recording)):
            vector = classifier.embedding(name, recording.to(classifier.device)).mean(dim=1).cpu()
        yield rows[index], "test", tested[rows[index]], vector


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
