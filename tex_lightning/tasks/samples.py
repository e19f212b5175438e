"""Classify one sample of the store."""

import time

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.data.datamodule import load_sample
from tex_lightning.data.folds import Sample
from tex_lightning.data.store import Store
from tex_lightning.decision.voting import Vote
from tex_lightning.devices import synchronise
from tex_lightning.errors import UserError


def classify_sample(
    classifier: SurfaceClassifier, sample: Sample, store: Store
) -> tuple[Vote, float]:
    """Classify one sample; the time in ms runs from decoded recordings to the label.

    Raises:
        UserError: Naming the file, if a recording cannot be used.
    """
    trace, photo = load_sample(sample, store)
    device = classifier.device
    synchronise(device)
    begin = time.perf_counter()
    try:
        vote = classifier.classify(trace, photo)
    except UserError as error:
        files = [str(row.path) for row in (sample.haptic, sample.image) if row is not None]
        raise UserError(f"{' and '.join(files)}: {error}") from error
    synchronise(device)
    return vote, (time.perf_counter() - begin) * 1000
