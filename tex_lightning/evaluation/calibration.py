"""Calibrate probabilities on the validation fold, and measure their reliability.

The probabilities of a sample are the means over its fragments; its confidence is that of the class
that won the vote.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import torch
from scipy.stats import mannwhitneyu
from torch import Tensor
from torchmetrics.functional.classification import binary_calibration_error

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.vote import RULES
from tex_lightning.core.devices import to_cpu
from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import class_indices
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.networks.temperature import fit_temperature

BINS = 15
IMPROBABLE = 1e-12  # the least probability of which a logarithm is taken
Array = npt.NDArray[np.float64]


def calibration(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """Return how well the mean probabilities of samples fit their classes; 0 is best.

    Returns:
        ``ece``, the expected calibration error of the confidence in 15 equal bins; ``brier``, the
        squared error of the probabilities of all classes, added up (Brier 1950, from 0 to 2); and
        ``nll``, the negative natural logarithm of the true class's probability, which is taken
        for the rounding error of float64, 2.2e-16, where it is less. The last two are means over
        samples.
    """
    confidence, correct = confidences(outcomes), correct_votes(outcomes)
    error = binary_calibration_error(
        torch.from_numpy(confidence), torch.from_numpy(correct).int(), n_bins=BINS
    )
    true, brier = np.array([_of_true_class(outcome) for outcome in outcomes]).T
    least = np.finfo(np.float64).eps
    nll = -np.log(true.clip(least, 1))
    return {"ece": float(error), "brier": float(brier.mean()), "nll": float(nll.mean())}


def _of_true_class(outcome: Outcome) -> tuple[float, float]:
    """Return the probability of the true class, and the squared error over all classes.

    A class that was not trained has the probability 0.
    """
    others = dict(outcome.class_probabilities)
    true = others.pop(outcome.label, 0.0)
    return true, (1 - true) ** 2 + sum(value**2 for value in others.values())


def confidences(outcomes: Sequence[Outcome]) -> Array:
    """Return the mean probability of the predicted class of each sample, at most 1.

    A mean may be rounded to a little more than 1, and torchmetrics would then take all of them for
    logits.
    """
    won = [outcome.class_probabilities[outcome.predicted] for outcome in outcomes]
    return np.minimum(won, 1.0)


def correct_votes(outcomes: Sequence[Outcome]) -> npt.NDArray[np.bool_]:
    """Return whether each vote is correct."""
    return np.array([outcome.correct for outcome in outcomes])


def auroc(negative: Sequence[float], positive: Sequence[float]) -> float | None:
    """Return the area under the ROC curve; None if either side is empty.

    It is the chance that a positive scores above a negative, where ties count half.
    """
    if not len(negative) or not len(positive):
        return None
    pairs = len(negative) * len(positive)
    return float(mannwhitneyu(positive, negative).statistic / pairs)


def sample_loss(
    card: Card, samples: Sequence[Sample], scores: Sequence[Tensor], temperature: float
) -> float:
    """Return the mean negative logarithm of the probability that samples' own class gets.

    Args:
        card: Card of the classifier.
        samples: At least one.
        scores: Class scores (classes, fragments) of each.
        temperature: Divisor of the scores before the softmax.
    """
    labels = class_indices([sample.label for sample in samples], card.classes)
    votes = [RULES[card.rule](logits, temperature) for logits in to_cpu(scores)]
    likely = [vote.probabilities[label] for vote, label in zip(votes, labels, strict=True)]
    return float(-torch.stack(likely).clamp_min(IMPROBABLE).log().mean())


def sample_temperature(card: Card, samples: Sequence[Sample], scores: Sequence[Tensor]) -> float:
    """Return the temperature under which the probabilities of samples fit their classes best.

    Args:
        card: Card of the classifier.
        samples: Samples of the validation fold, at least one.
        scores: Class scores (classes, fragments) of each.
    """
    if RULES[card.rule].by_mean_score:  # which alone counts then
        scores = [logits.mean(dim=1, keepdim=True) for logits in scores]
    return fit_temperature(scores, class_indices([x.label for x in samples], card.classes))
