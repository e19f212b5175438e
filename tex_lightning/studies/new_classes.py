"""Open recordings of new classes, and add these to a classifier and its card."""

from dataclasses import replace

from tex_lightning.classifier.card import CROSSVAL
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import DataConfig
from tex_lightning.data.folds import split
from tex_lightning.data.inspection import training_ranges
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import plural
from tex_lightning.errors import UserError, listed
from tex_lightning.learning.enrolment import add_classes
from tex_lightning.learning.finish import position_features
from tex_lightning.learning.provenance import digests
from tex_lightning.studies.dataset import Dataset, decode_for


def open_new_classes(data: DataConfig, classifier: SurfaceClassifier) -> Dataset:
    """Read and decode the recordings of classes that a classifier does not know.

    Args:
        data: Where recordings come from; its test fold, if there is one, is left out.
        classifier: Says how they are decoded.

    Raises:
        UserError: If there is no such class, or one lacks a sense.
    """
    card = classifier.card
    table = read_recordings(data, card.modalities, least=1)
    names = [name for name in table.classes if name not in card.classes]
    if not names:
        raise UserError(
            f"The checkpoint already has {listed(table.classes)}; give recordings of a new class."
        )
    rows = split(table.in_classes(names), data, trains=True).train
    dataset = decode_for(classifier, data, rows.of(*card.modalities), names)
    for modality in card.modalities:
        learnt = {row.label for row in dataset.recordings.of(modality)}
        if absent := [name for name in names if name not in learnt]:
            raise UserError(
                f"There are no {plural(modality)} of {listed(absent)} to learn from, and this "
                f"{card.kind} network uses {' and '.join(card.modalities)}; record them, or "
                "leave the class out."
            )
    return dataset


def enroll(classifier: SurfaceClassifier, dataset: Dataset) -> SurfaceClassifier:
    """Copy a classifier to the CPU, and add the classes of a data set to it and its card.

    Args:
        classifier: On the device that computes the features; it ends on the CPU.
        dataset: Recordings of the new classes.

    Raises:
        UserError: If classes cannot be added to this network.
    """
    card, rows, store = classifier.card, dataset.recordings, dataset.store
    features = {}
    for name, sense in classifier.senses.items():
        recordings = rows.of(sense.modality).rows
        embeddings = [x.cpu() for x in position_features(classifier, name, recordings, store)]
        pairs = list(zip(recordings, embeddings, strict=True))
        features[name] = [
            [embedding for row, embedding in pairs if row.label == label]
            for label in dataset.classes
        ]
    extended = add_classes(classifier.cpu(), dataset.classes, features)
    ranges = {name: training_ranges(rows.of(name), store) for name in card.input_ranges}
    seen = card.trained_on.get("seen", [])
    old = ("val_loss", "left_out", CROSSVAL)  # what holds of the old classes alone
    training = {key: value for key, value in card.training.items() if key not in old}
    training |= {"val_loss": None, "left_out": {}}
    extended.card = replace(
        extended.card,
        training=training,
        calibration=card.calibration,
        input_ranges={
            modality: {
                name: [min(low, ranges[modality][name][0]), max(high, ranges[modality][name][1])]
                for name, (low, high) in old.items()
            }
            for modality, old in card.input_ranges.items()
        },
        trained_on={**card.trained_on, "seen": list(dict.fromkeys([*seen, *digests(rows)]))},
    )
    return extended
