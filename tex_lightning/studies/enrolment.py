"""Add classes to a trained classifier: recordings, network, card, file."""

from dataclasses import replace
from pathlib import Path

import torch

from tex_lightning.classifier.card import Card, read_checkpoint
from tex_lightning.classifier.classifier import SurfaceClassifier, Trained, lightning_state
from tex_lightning.config import Config
from tex_lightning.config.keys import nearest
from tex_lightning.core.files import write_atomically
from tex_lightning.data.folds import next_of_each, split
from tex_lightning.data.quality import training_ranges
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings, plural
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError, listed
from tex_lightning.learning.enrolment import Fragments, add_classes, check_extensible
from tex_lightning.learning.statistics import position_features
from tex_lightning.studies.dataset import Dataset, open_store
from tex_lightning.studies.leaks import digests

VALIDATED = ("confidence_threshold", "disagreement")  # of a calibration, for the old classes alone


def open_new_classes(config: Config, classifier: SurfaceClassifier) -> Dataset:
    """Read the recordings of new classes, without a test fold if there is one, and decode them.

    Raises:
        UserError: If the network cannot be extended, or a class is known already, absent or lacks
            a sense.
    """
    check_extensible(classifier)
    data, card, only = config.data, classifier.card, config.enroll.only
    table = read_recordings(data, card.modalities, least=1)
    rows = table.without(row for row in table if row.modality not in card.modalities)
    if not rows.classes:
        raise UserError(
            f"The data has no {' or '.join(map(plural, card.modalities))} to learn a class from, "
            f"which is what this {card.kind} network looks at; record some."
        )
    for name in only or ():
        if name not in rows.classes:
            raise UserError(
                f"enroll.only names {name}{nearest(name, rows.classes)}, which the data does not "
                f"have; choose from {listed(rows.classes)}."
            )
    names = [name for name in rows.classes if only is None or name in only]
    if known := [name for name in names if name in card.classes]:
        raise UserError(
            f"The checkpoint knows {listed(known)} already; name the new classes in enroll.only."
        )
    rows = rows.in_classes(names)
    if data.test_fold is not None:
        rows = split(rows, data).train
    elif data.per_class is not None:
        chosen = next_of_each(rows.rows, data.per_class, 0, data.folds)
        rows = replace(rows, rows=tuple(chosen))
    opened = Dataset.decode(rows, Recordings(()), open_store(data, classifier), names)
    dataset = opened.usable(classifier.senses.values(), skip_bad=data.skip_bad)
    for modality in card.modalities:
        if absent := sorted(set(names) - {row.label for row in dataset.recordings.of(modality)}):
            raise UserError(
                f"There are no {plural(modality)} of {listed(absent)} to learn from, and this "
                f"{card.kind} network looks at {' and '.join(card.modalities)}; record them, or "
                "add the class to a network that does without."
            )
    return dataset


def enroll(classifier: SurfaceClassifier, rows: Recordings, store: Store) -> SurfaceClassifier:
    """Copy a classifier to the CPU, and add the classes of the recordings to it and its card.

    Args:
        classifier: On the device that computes the features; it ends on the CPU.
        rows: Rows of the new classes.
        store: Where they are decoded.

    Raises:
        UserError: If classes cannot be added to this network.
    """
    features: dict[str, Fragments] = {}
    for name, sense in classifier.senses.items():
        recordings = rows.of(sense.modality).rows
        embeddings = position_features(classifier, name, recordings, store)
        pairs = list(zip(recordings, embeddings, strict=True))
        features[name] = [
            [embedding for row, embedding in pairs if row.label == label] for label in rows.classes
        ]
    extended = add_classes(classifier.cpu(), rows.classes, features)
    card = extended.card
    seen = card.trained_on.get("seen", [])
    new = [digest for digest in digests(rows) if digest not in seen]
    extended.card = replace(
        card,
        calibration=_still_valid(card),
        input_ranges=_wider_ranges(card, rows, store),
        trained_on={**card.trained_on, "seen": [*seen, *new]},
    )
    return extended


def write_checkpoint(
    classifier: SurfaceClassifier, source: Path, target: Path, seconds: float
) -> Trained:
    """Write a changed classifier as the training wrote its source.

    Args:
        classifier: On the CPU.
        source: Checkpoint that it came from.
        target: The new file.
        seconds: Seconds that the change took, which are added to those of the training.
    """
    content = read_checkpoint(source)
    content["hyper_parameters"]["card"] = classifier.card.to_dict()
    content["state_dict"] = lightning_state(classifier)
    content["fit_seconds"] = content.get("fit_seconds", 0.0) + seconds
    content["val_loss"] = None
    write_atomically(target, lambda partial: torch.save(content, partial))
    return Trained(classifier, target, content["fit_seconds"])


def _still_valid(card: Card) -> dict[str, float]:
    """Return the calibration without what was shown for the old classes alone."""
    return {name: value for name, value in card.calibration.items() if name not in VALIDATED}


def _wider_ranges(card: Card, rows: Recordings, store: Store) -> dict[str, dict[str, list[float]]]:
    """Return by modality the ends of each measure, over the old and the new recordings."""
    ranges = {}
    for modality, old in card.input_ranges.items():
        new = training_ranges(rows.of(modality), store)
        ranges[modality] = {
            name: [min(low, new[name][0]), max(high, new[name][1])]
            for name, (low, high) in old.items()
        }
    return ranges
