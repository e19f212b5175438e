"""Measure the statistics of a trained network's features for every class of its training set."""

from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics
from tex_lightning.core.groups import leave_out
from tex_lightning.core.progress import track
from tex_lightning.data.recordings import Recording, Recordings, class_indices, plural
from tex_lightning.data.store import Store, load_recording


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
    what = plural(classifier.sense(name).modality)
    for row in track(rows, f"Statistics of {what}"):
        yield classifier.embedding(name, load_recording(row, store)).cpu()
