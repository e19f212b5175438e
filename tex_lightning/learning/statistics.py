"""Measure feature statistics of every class, and the novelties that set ``decision.unknown``."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from tex_lightning.classifier.card import NOVELTIES, Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics
from tex_lightning.core.groups import leave_out
from tex_lightning.core.progress import track
from tex_lightning.data.folds import Sample, Split, make_samples
from tex_lightning.data.recordings import Recording, Recordings, class_indices, plural
from tex_lightning.data.store import Store, load_recording, load_sample


def keep_statistics(
    classifier: SurfaceClassifier, rows: Recordings, store: Store
) -> dict[str, list[float]]:
    """Give a trained classifier its :attr:`~SurfaceClassifier.statistics`, of every sense.

    Args:
        classifier: Trained, on the device that computes the features; left in evaluation mode.
        rows: The training recordings, which are not perturbed.
        store: Where they are decoded.

    Returns:
        By sense :func:`left_out_novelties` of its recordings.
    """
    novelties: dict[str, list[float]] = {}
    classes = classifier.card.classes
    classifier.eval()
    for name, sense in classifier.senses.items():
        own = rows.of(sense.modality).rows
        labels = torch.tensor(class_indices([row.label for row in own], classes))
        means = [each.mean(dim=1) for each in position_features(classifier, name, own, store)]
        features = torch.stack(means)
        found = FeatureStatistics.of(features, labels, len(classes))
        classifier.statistics[name] = found.to(classifier.device)
        groups = [row.group_key for row in own]
        novelties[name] = left_out_novelties(features, labels, len(classes), groups)
    return novelties


def left_out_novelties(
    features: Tensor, labels: Tensor, classes: int, groups: Sequence[str]
) -> list[float]:
    """Novelty of every training recording by statistics without its part of the groups.

    Args:
        features: (recordings, D).
        labels: (recordings,) class indices, of every class at least one.
        classes: Number of classes.
        groups: Group of each recording.

    Returns:
        Nothing where a class has but one group, which cannot be left out.
    """
    parts = torch.tensor(leave_out(labels.tolist(), groups))
    found = torch.empty(len(parts))
    for part in set(parts.tolist()):
        out = parts == part
        statistics = FeatureStatistics.of(features[~out], labels[~out], classes)
        found[out] = statistics.novelty(features[out])
    return [float(each) for each in found]


@torch.inference_mode()
def position_features(
    classifier: SurfaceClassifier, name: str, rows: Sequence[Recording], store: Store
) -> Iterator[Tensor]:
    """Features (D, positions) of one sense, on the CPU, of each recording.

    Args:
        classifier: In evaluation mode.
        name: Name of the sense.
        rows: Recordings of its modality.
        store: Where they are decoded.
    """
    what = plural(classifier.senses[name].modality)
    for row in track(rows, f"Statistics of {what}"):
        yield classifier.embedding(name, load_recording(row, store)).cpu()


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
    (docs/calibration.md).

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
