"""Novelties of known recordings on which nothing was fitted."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch

from tex_lightning.classifier.card import NOVELTIES, Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.data.folds import Sample, Split, make_samples
from tex_lightning.data.store import Store, load_sample

MOST = 1000  # samples; a thousandth is finer than any rate that is asked for


def card_with_novelties(
    classifier: SurfaceClassifier,
    novelties: Mapping[str, Sequence[float]],
    parts: Split,
    store: Store,
) -> Card:
    """Return the card with what ``decision.unknown`` is set by: novelties of known samples.

    They are those of the validation fold, and where no layer before the scores was trained also
    those of training recordings that were left out of the statistics in turn. Trained features fit
    their training recordings too well: of new ones a third would lie above their 95 %
    (docs/unknown.md).

    Args:
        classifier: Trained, in evaluation mode.
        novelties: By sense those of training recordings that were left out of the statistics.
        parts: Parts of the recordings.
        store: Their recordings decoded.
    """
    card = classifier.card
    if card.novelties or not classifier.statistics:
        return card
    left_out = _left_out(novelties, classifier, parts)
    validated = _measured(classifier, make_samples(parts.val, card.modalities), store)
    rows = [*left_out, *validated]
    rows = rows[:: max(1, math.ceil(len(rows) / MOST))]
    if rows:
        columns = dict(zip(card.sense_names, map(list, zip(*rows, strict=True)), strict=True))
        card = replace(card, calibration={**card.calibration, NOVELTIES: columns})
    return card


def _measured(
    classifier: SurfaceClassifier, samples: Sequence[Sample], store: Store
) -> list[list[float]]:
    """Of every sample the novelties of all senses."""
    found = []
    for sample in samples:
        with torch.inference_mode():
            sensed = classifier.sense_outputs(**load_sample(sample, store))
        known = [sensed[name].novelty for name in classifier.card.sense_names]
        found.append([float(each) for each in known if each is not None])
    return found


def _left_out(
    novelties: Mapping[str, Sequence[float]], classifier: SurfaceClassifier, parts: Split
) -> list[list[float]]:
    """The same of the samples of the training, as far as it was measured there."""
    if not all(novelties.get(name) for name in classifier.card.sense_names):
        return []
    modalities = {name: sense.modality for name, sense in classifier.senses.items()}
    known = {
        name: dict(zip(parts.train.of(modality).rows, novelties[name], strict=True))
        for name, modality in modalities.items()
    }
    samples = make_samples(parts.train, classifier.card.modalities)
    return [
        [known[name][sample.recordings[modality]] for name, modality in modalities.items()]
        for sample in samples
    ]
