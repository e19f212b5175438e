"""Metrics of training, validation and testing, by torchmetrics."""

import torch
from torch import Tensor, nn
from torchmetrics import Metric, MetricCollection
from torchmetrics.classification import (
    BinaryAUROC,
    BinaryCalibrationError,
    MulticlassAccuracy,
    MulticlassConfusionMatrix,
)

from tex_lightning.classifier.vote import Vote
from tex_lightning.evaluation.calibration import BINS

CONFUSION = "confusion"  # a matrix, which is drawn and not logged
THRESHOLDS = 1000  # of the ROC curve, so that its memory does not grow with the samples


def accuracy(classes: int) -> MulticlassAccuracy:
    """Make the share of correct predictions."""
    return MulticlassAccuracy(classes, average="micro", validate_args=False)


def vote_metrics(classes: int, stage: str) -> MetricCollection:
    """Make the metrics of whole samples, see :func:`update_metrics`.

    ``fragment_accuracy`` and ``vote_accuracy`` are shares of all fragments and of all samples,
    ``ece`` is the expected calibration error of the probability of the class that won (lower is
    better), and ``auroc`` the area under the ROC curve of all class probabilities, each class
    against the rest and pooled: unlike the mean over classes it exists where one has no sample.

    Args:
        classes: Their number.
        stage: ``val`` or ``test``; the names begin with it. Testing counts confusions as well.
    """
    metrics: dict[str, Metric | MetricCollection] = {
        "fragment_accuracy": accuracy(classes),
        "vote_accuracy": accuracy(classes),
        "ece": BinaryCalibrationError(BINS, validate_args=False),
        "auroc": BinaryAUROC(thresholds=THRESHOLDS, validate_args=False),
    }
    if stage == "test":
        metrics[CONFUSION] = MulticlassConfusionMatrix(classes, validate_args=False)
    return MetricCollection(metrics, prefix=f"{stage}/", compute_groups=False)


def update_metrics(metrics: MetricCollection, vote: Vote, label: Tensor) -> None:
    """Add the vote on a sample of class ``label`` () to :func:`vote_metrics`."""
    # a mean probability may be rounded to more than 1, which torchmetrics would take for a logit
    probabilities = vote.probabilities.clamp(max=1).float().to(label.device)
    fragments = vote.fragments.to(label.device)
    winner = torch.full_like(label, vote.label)[None]
    correct = (label == vote.label).long()[None]
    one_hot = nn.functional.one_hot(label, len(probabilities))
    metrics["fragment_accuracy"].update(fragments, label.expand_as(fragments))
    metrics["vote_accuracy"].update(winner, label[None])
    metrics["ece"].update(probabilities[vote.label][None], correct)
    metrics["auroc"].update(probabilities, one_hot)
    if CONFUSION in metrics:
        metrics[CONFUSION].update(winner, label[None])
