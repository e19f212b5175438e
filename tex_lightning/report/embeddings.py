"""Mean embeddings of recordings for TensorBoard's projector, with a thumbnail of each."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.core.devices import computing_threads
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import load_recording
from tex_lightning.report.artifacts import Points
from tex_lightning.report.pictures import recording_picture
from tex_lightning.report.samples import SampleView
from tex_lightning.text import printable

MAX_POINTS = 300  # recordings of each part, evenly chosen
MAX_DIMENSIONS = 256  # beyond which they are projected to as many principal components
SIDE = 48  # pixels of a thumbnail


class _Point(NamedTuple):
    row: Recording
    part: str
    predicted: str
    vector: Tensor


def projector_artifacts(classifier: SurfaceClassifier, view: SampleView) -> Iterator[Points]:
    """Yield the embeddings of each sense: those of training that are at hand, and of the test."""
    for name, sense in classifier.senses.items():
        if classifier.statistics_of(name) is None:
            continue
        points = [*_trained(classifier, name), *_tested(classifier, name, view)]
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
            np.stack([recording_picture(view.store.load(row), rate, (SIDE, SIDE)) for row in rows]),
        )


def _trained(classifier: SurfaceClassifier, name: str) -> Iterator[_Point]:
    rows, vectors = classifier.trained_embeddings.get(name, ((), torch.empty(0)))
    for index in _some(len(rows)):
        yield _Point(rows[index], "training", "", vectors[index])


@torch.inference_mode()
def _tested(classifier: SurfaceClassifier, name: str, view: SampleView) -> Iterator[_Point]:
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
