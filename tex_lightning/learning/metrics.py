"""Metrics of training, validation and testing, as collections of torchmetrics."""

from collections.abc import Callable

import torch
from torch import Tensor, nn
from torchmetrics import Metric, MetricCollection
from torchmetrics.classification import (
    BinaryCalibrationError,
    MulticlassAccuracy,
    MulticlassConfusionMatrix,
)
from torchmetrics.wrappers.abstract import WrapperMetric

from tex_lightning.classifier.vote import Vote
from tex_lightning.evaluation.calibration import BINS

CONFUSION = "confusion"  # a matrix, which is drawn and not logged
CUT_BITS = 14  # of a float32 probability; what is left has 10 significant ones
LEVELS = (0x3F800000 >> CUT_BITS) + 1  # of probabilities up to 1, whose bits are these

Inputs = tuple[Tensor, Tensor]  # predictions and targets, as torchmetrics takes them


class VoteMetric(WrapperMetric):
    """A metric that is updated with the decision on one sample.

    Args:
        metric: What is computed.
        inputs: Takes its predictions and targets from a vote and the true class ().
    """

    def __init__(self, metric: Metric, inputs: Callable[[Vote, Tensor], Inputs]) -> None:
        super().__init__()
        self.metric = metric
        self.inputs = inputs

    def update(self, vote: Vote, label: Tensor) -> None:
        """Add the vote on a sample of class ``label`` ()."""
        self.metric.update(*self.inputs(vote, label))

    def compute(self) -> Tensor:
        """Compute the metric of all samples."""
        value: Tensor = self.metric.compute()
        return value

    def reset(self) -> None:
        """Forget all samples."""
        super().reset()
        self.metric.reset()


class HistogramAUROC(Metric):
    """Area under the ROC curve, in memory that grows with neither samples nor classes.

    Probabilities are told apart to 10 significant bits, a thousandth of themselves; a positive and
    a negative one that are equal to these count half.
    """

    counts: Tensor  # (2, levels), of negatives and positives

    def __init__(self) -> None:
        super().__init__()
        zeros = torch.zeros(2, LEVELS, dtype=torch.int64)
        self.add_state("counts", zeros, dist_reduce_fx="sum")

    def update(self, probabilities: Tensor, target: Tensor) -> None:
        """Add probabilities (n,) float32, 0 to 1, and what is true of each, 0 or 1.

        NaN, of a training that diverges, counts as 0.
        """
        levels = probabilities.nan_to_num().abs().view(torch.int32) >> CUT_BITS  # -0 has a sign
        for truth, counts in enumerate(self.counts):
            counts += levels[target == truth].bincount(minlength=LEVELS)

    def compute(self) -> Tensor:
        """Compute the chance that a positive is more probable than a negative, 0 to 1.

        NaN where one of both has not occurred.
        """
        negative, positive = self.counts
        twice_below = 2 * negative.cumsum(dim=0) - negative
        twice: Tensor = (positive * twice_below).sum() / (positive.sum() * negative.sum())
        return twice / 2


def _fragments(vote: Vote, label: Tensor) -> Inputs:
    fragments = vote.fragments.to(label.device)
    return fragments, label.expand_as(fragments)


def _winner(vote: Vote, label: Tensor) -> Inputs:
    return torch.full_like(label, vote.label)[None], label[None]


def _confidence(vote: Vote, label: Tensor) -> Inputs:
    return _probabilities(vote, label)[vote.label][None], (label == vote.label).long()[None]


def _one_against_rest(vote: Vote, label: Tensor) -> Inputs:
    return _probabilities(vote, label), nn.functional.one_hot(label, len(vote.probabilities))


def _probabilities(vote: Vote, label: Tensor) -> Tensor:
    """Probabilities on the metrics' device, as float32, since not every device has float64.

    A mean probability may be rounded to more than 1, which torchmetrics would take for a logit.
    """
    return vote.probabilities.clamp(max=1).float().to(label.device)


def train_metrics(classes: int) -> MetricCollection:
    """Make the metrics of a training batch, updated with predicted and true class of fragments."""
    return MetricCollection({"fragment_accuracy": _accuracy(classes)}, prefix="train/")


def vote_metrics(classes: int, stage: str) -> MetricCollection:
    """Make the metrics of whole samples, updated with a :class:`Vote` and a class index ().

    ``fragment_accuracy`` and ``vote_accuracy`` are shares of all fragments and of all samples,
    ``ece`` is the expected calibration error of the probability of the class that won (lower is
    better), and ``auroc`` the area under the ROC curve of all class probabilities, each class
    against the rest and pooled: unlike the mean over classes it exists where one has no sample.

    Args:
        classes: Their number.
        stage: ``val`` or ``test``; the names begin with it. Testing counts confusions as well.
    """
    metrics: dict[str, Metric | MetricCollection] = {
        "fragment_accuracy": VoteMetric(_accuracy(classes), _fragments),
        "vote_accuracy": VoteMetric(_accuracy(classes), _winner),
        "ece": VoteMetric(BinaryCalibrationError(BINS, validate_args=False), _confidence),
        "auroc": VoteMetric(HistogramAUROC(), _one_against_rest),
    }
    if stage == "test":
        confusion = MulticlassConfusionMatrix(classes, validate_args=False)
        metrics[CONFUSION] = VoteMetric(confusion, _winner)
    return MetricCollection(metrics, prefix=f"{stage}/", compute_groups=False)


def _accuracy(classes: int) -> MulticlassAccuracy:
    return MulticlassAccuracy(classes, average="micro", validate_args=False)
