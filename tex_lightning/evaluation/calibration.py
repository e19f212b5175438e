"""Reliability of probabilities: calibration errors, proper scores, selective prediction.

The probabilities of a sample are the means over its fragments; its confidence is that of the class
that won the vote.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torchmetrics.functional.classification import binary_auroc, binary_calibration_error

from tex_lightning.evaluation.outcomes import Outcome

BINS = 15
MIN_PROBABILITY = 1e-12  # that a logarithm is taken of

Array = npt.NDArray[np.float64]


def calibration(outcomes: Sequence[Outcome], classes: list[str]) -> dict[str, float]:
    """Scores of the probabilities of test samples, pooled.

    Returns:
        ``ece``, the expected calibration error of the confidence in 15 bins of equal width;
        ``brier``, the mean squared distance, summed over classes (0 to 2), with more than 128
        classes too low by less than 0.01; ``nll``, the mean
        negative log-likelihood in nats; ``augrc``, the area under the generalised risk-coverage
        curve (Traub et al., NeurIPS 2024): the mean share of all samples that is accepted and
        wrong, 0 to 0.5. Lower is better for all.
    """
    scores = np.array([_brier_and_likelihood(outcome, len(classes)) for outcome in outcomes])
    brier, likelihoods = scores.T
    confidence, correct = confidences(outcomes), correct_votes(outcomes)
    return {
        "ece": float(
            binary_calibration_error(
                torch.from_numpy(confidence), torch.from_numpy(correct).int(), n_bins=BINS
            )
        ),
        "brier": float(brier.mean()),
        "nll": float(-np.log(np.maximum(likelihoods, MIN_PROBABILITY)).mean()),
        "augrc": augrc(confidence, correct),
    }


def _brier_and_likelihood(outcome: Outcome, classes: int) -> tuple[float, float]:
    """Of one sample; classes whose probabilities were not kept share what is left evenly."""
    known = outcome.class_probabilities
    own, values = known[outcome.label], np.array(list(known.values()))
    rest = (1 - values.sum()) ** 2 / max(classes - len(known), 1)
    return float(np.square(values).sum() + rest - own**2 + (1 - own) ** 2), own


def confidences(outcomes: Sequence[Outcome]) -> Array:
    """Mean probability of the class that won, for each sample, at most 1.

    A mean may be rounded to a little more than 1, and torchmetrics would then take all of them for
    logits.
    """
    won = [outcome.class_probabilities[outcome.predicted] for outcome in outcomes]
    return np.minimum(won, 1.0)


def correct_votes(outcomes: Sequence[Outcome]) -> npt.NDArray[np.bool_]:
    """Whether each vote is correct."""
    return np.array([outcome.label == outcome.predicted for outcome in outcomes])


def risk_coverage(confidence: Array, correct: npt.NDArray[np.bool_]) -> tuple[Array, Array]:
    """Coverage, and the share of all samples that is accepted and wrong, at every threshold.

    Samples of the same confidence are accepted together. Both begin with 0.
    """
    order = np.argsort(-confidence, kind="stable")
    last = np.append(np.diff(confidence[order]) != 0, True)  # of its confidence
    accepted = np.arange(1, len(order) + 1)[last] / len(order)
    wrong = np.cumsum(~correct[order])[last] / len(order)
    return np.insert(accepted, 0, 0.0), np.insert(wrong, 0, 0.0)


def augrc(confidence: Array, correct: npt.NDArray[np.bool_]) -> float:
    """Area under :func:`risk_coverage`."""
    coverage, wrong = risk_coverage(confidence, correct)
    return float(np.trapezoid(wrong, coverage))


def selective(outcomes: Sequence[Outcome], reject_below: float) -> dict[str, float | None]:
    """Coverage and accuracy when no label is given below a confidence.

    Returns:
        ``reject_below``; ``coverage``, the share of samples with a label; ``selective_accuracy``
        of those, None if there is none.
    """
    accepted = confidences(outcomes) >= reject_below
    correct = correct_votes(outcomes)[accepted]
    return {
        "reject_below": reject_below,
        "coverage": float(accepted.mean()),
        "selective_accuracy": float(correct.mean()) if len(correct) else None,
    }


def unknown_auroc(known: Sequence[Outcome], unknown: Sequence[Outcome]) -> dict[str, Any]:
    """How well confidence separates samples of trained classes from those of others.

    Returns:
        ``classes`` never seen, their number of ``samples``, and ``auroc``: the probability that a
        known sample gets more confidence than an unknown one; ``novelty_auroc``, that it gets less
        novelty, None where that is not known.
    """
    novelties = [[outcome.novelty for outcome in part] for part in (known, unknown)]
    told = not any(math.isnan(value) for part in novelties for value in part)
    return {
        "classes": sorted({outcome.label for outcome in unknown}),
        "samples": len(unknown),
        "auroc": auroc(confidences(unknown).tolist(), confidences(known).tolist()),
        "novelty_auroc": auroc(*map(_bounded, novelties)) if told else None,
    }


def _bounded(novelties: Sequence[float]) -> list[float]:
    """From 0 to 1, in the same order."""
    return [value / (1 + value) for value in novelties]


def auroc(negative: Sequence[float], positive: Sequence[float]) -> float | None:
    """Compute the chance that a positive scores above a negative; ties count half.

    Args:
        negative: Scores from 0 to 1.
        positive: The same of the others.

    Returns:
        The area under the ROC curve; None if either side is empty.
    """
    if not negative or not positive:
        return None
    # beyond 0 and 1, by rounding alone, torchmetrics would take scores for logits
    scores = torch.tensor([*negative, *positive], dtype=torch.float64).clamp(0, 1)
    target = torch.tensor([0] * len(negative) + [1] * len(positive))
    return float(binary_auroc(scores, target))
