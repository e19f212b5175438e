"""The recordings that a checkpoint may be tested on."""

from dataclasses import replace

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import DataConfig
from tex_lightning.data.folds import split
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import Store, cache_root
from tex_lightning.errors import UserError, listed
from tex_lightning.runs.leaks import refuse_leak
from tex_lightning.runs.workspace import hold_out


def recordings_to_test(data: DataConfig, classifier: SurfaceClassifier, who: str) -> Recordings:
    """The recordings to test on, without the classes in ``data.hold_out``.

    Args:
        data: Where they come from and which fold.
        classifier: What is tested.
        who: Its name in messages.

    Raises:
        UserError: If their classes are unknown to the checkpoint, or it was trained on them.
    """
    card = classifier.card
    rows, _ = hold_out(read_recordings(data, card.modalities), data.hold_out)
    unknown = [label for label in rows.classes if label not in card.classes]
    if unknown:
        raise UserError(
            f"{who} does not know the class {listed(unknown)}; leave it out of the "
            "data, name it in data.hold_out or train on it."
        )
    return _tested(rows, data, card, who)


def open_store(data: DataConfig, classifier: SurfaceClassifier) -> Store:
    """Open a store that decodes recordings with a checkpoint's settings.

    Only ``data.file_rate`` belongs to the files themselves and counts if it is given.
    """
    decoders = {
        sense.modality: sense.decoder.assuming(data.file_rate)
        for sense in classifier.senses.values()
    }
    return Store(cache_root(data.cache_dir), decoders)


def held_out_to_test(data: DataConfig, classifier: SurfaceClassifier) -> Recordings:
    """The recordings of the classes in ``data.hold_out`` in the test fold.

    Raises:
        UserError: If there is no such class, or the checkpoint was trained on it.
    """
    card = classifier.card
    _, held = hold_out(read_recordings(data, card.modalities), data.hold_out)
    return _tested(held, data, card, "The checkpoint")


def _tested(rows: Recordings, data: DataConfig, card: Card, who: str) -> Recordings:
    wanted = rows.without(row for row in rows if row.modality not in card.modalities)
    test = split(wanted, data).test
    refuse_leak(test, card, who, data)
    return replace(test, notes=rows.notes)
