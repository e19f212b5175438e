"""The recipe of a training: the card of a network to train, and what it starts from."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, DataConfig
from tex_lightning.data.folds import Split
from tex_lightning.data.quality import training_ranges
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError
from tex_lightning.learning.leaks import refuse_leak, trained_on
from tex_lightning.learning.start import starting_classifier


def given_start(path: Path, card: Card, test: Recordings, data: DataConfig) -> SurfaceClassifier:
    """Read a unimodal checkpoint, if FusionNet may start from it.

    Args:
        path: The checkpoint.
        card: Card of such a network as this run would train it.
        test: The test recordings.
        data: Division into folds or by condition.

    Raises:
        UserError: If it is no such network, classes differ, or it has seen the fold that this run
            tests.
    """
    start = SurfaceClassifier.from_checkpoint(path, card.kind)
    theirs = start.card
    if theirs.classes != card.classes:
        raise UserError(
            f"Checkpoint {path} knows {len(theirs.classes)} classes that are not the "
            f"{len(card.classes)} of this data; train it on the same data."
        )
    refuse_leak(test.of(theirs.modalities[0]), theirs, f"Checkpoint {path}", data)
    return start


def complete_recipe(
    config: Config,
    card: Card,
    parts: Split,
    store: Store,
    starts: Mapping[str, SurfaceClassifier],
    known: Mapping[str, Any],
) -> Card:
    """Add to the card of a network to train what its data say, and what it starts from.

    Args:
        config: Names the weights that a trunk starts from, and the fold.
        card: Card of the network as it is configured.
        parts: Recordings by part.
        store: Decoded files.
        starts: By sense the networks that FusionNet starts from: its senses are theirs.
        known: What is known of the training beforehand.

    Raises:
        UserError: If its trunk cannot be used or has seen what is to be tested.
    """
    begun = [start.card for start in starts.values()]
    ranges = {name: seen for start in begun for name, seen in start.input_ranges.items()}
    for name in card.modalities:
        if name not in ranges:
            ranges[name] = training_ranges(parts.train.of(name), store)
    senses = {**card.senses, **{name: start.card.senses[name] for name, start in starts.items()}}
    source = None if card.baseline or begun else config.sources.get(card.kind)
    if source is not None and (start := starting_classifier(source, card.kind)) is not None:
        test = parts.test.of(card.modalities[0])
        refuse_leak(test, start.card, f"weights: checkpoint {source}", config.data)
        begun.append(start.card)
    seen = trained_on(card, parts, config.data, begun, source)
    return replace(card, senses=senses, input_ranges=ranges, trained_on=seen, training=dict(known))
