"""Calibrate probabilities and thresholds on the validation fold, and measure their reliability.

The probabilities of a sample are the means over its fragments; its confidence is that of the class
that won the vote.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import torch
from scipy.stats import binomtest, mannwhitneyu
from torchmetrics.functional.classification import binary_calibration_error

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import DecisionConfig, EngineConfig
from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import class_indices
from tex_lightning.data.store import Store, load_sample
from tex_lightning.evaluation.comparison import scarcest
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.evaluation.samples import classify_sample
from tex_lightning.inference.early_stopping import (
    SEQUENTIAL,
    SequentialClassifier,
    needs_threshold,
)
from tex_lightning.inference.engine import accelerate
from tex_lightning.networks.linear import fit_temperature

log = logging.getLogger(__name__)

BINS = 15
Array = npt.NDArray[np.float64]


def calibration(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """Return ``ece``, the expected calibration error of the confidence in 15 equal bins."""
    confidence, correct = confidences(outcomes), correct_votes(outcomes)
    error = binary_calibration_error(
        torch.from_numpy(confidence), torch.from_numpy(correct).int(), n_bins=BINS
    )
    return {"ece": float(error)}


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


def auroc(negative: Sequence[float], positive: Sequence[float]) -> float | None:
    """Compute the chance that a positive scores above a negative; ties count half.

    Returns:
        The area under the ROC curve; None if either side is empty.
    """
    if not len(negative) or not len(positive):
        return None
    pairs = len(negative) * len(positive)
    return float(mannwhitneyu(positive, negative).statistic / pairs)


def calibrated_card(
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    store: Store,
    decision: DecisionConfig,
    engine: EngineConfig,
    *,
    fitted: bool = False,
) -> Card:
    """Return the card with the temperature, and the threshold of sequential decisions.

    Args:
        classifier: Trained, in evaluation mode.
        samples: Samples of the validation fold; without any the card stays as it is.
        store: Their recordings.
        decision: How it decides.
        engine: How it runs.
        fitted: Whether its probabilities were fitted with its weights, to all training recordings:
            a temperature from the few of the validation fold would only make them worse.
    """
    card = classifier.card
    if not samples or "temperature" in card.calibration:
        return card
    found = dict(card.calibration)
    if not fitted:
        found["temperature"] = _temperature(classifier, samples, store)
    card = replace(card, calibration=found)
    if decision.name == SEQUENTIAL and needs_threshold(classifier):
        fast = accelerate(classifier, engine)
        fast.card = card
        found |= choose_confidence_threshold(fast, decision, samples, store)
    return replace(card, calibration=found)


def _temperature(classifier: SurfaceClassifier, samples: Sequence[Sample], store: Store) -> float:
    with torch.inference_mode():
        logits = [classifier.logits(**load_sample(sample, store)) for sample in samples]
    if classifier.card.rule == "score":  # which alone counts then
        logits = [scores.mean(dim=1, keepdim=True) for scores in logits]
    labels = class_indices([sample.label for sample in samples], classifier.card.classes)
    return fit_temperature(logits, labels)


def choose_confidence_threshold(
    classifier: SurfaceClassifier,
    decision: DecisionConfig,
    samples: Sequence[Sample],
    store: Store,
) -> dict[str, float]:
    """The lowest threshold whose decisions differ from the full ones rarely enough.

    From the strictest on, each threshold is tested and the first failure ends the search, so that
    the bound holds for the one chosen although several were tried (fixed-sequence testing).
    Samples that share a recording count as one, which differs if any of them does.

    Returns:
        ``confidence_threshold`` and the Clopper-Pearson bound ``disagreement`` that it holds;
        nothing if the strictest threshold has no such bound.
    """
    files = [{key: str(row.path) for key, row in each.recordings.items()} for each in samples]
    units, full = scarcest(files), _labels(classifier, samples, store)
    found: dict[str, float] = {}
    for threshold in sorted(decision.confidence_thresholds, reverse=True):
        tried = replace(decision, calibrated=False, confidence_threshold=threshold)
        labels = _labels(SequentialClassifier(classifier, tried), samples, store)
        differing = {
            unit for unit, own, all_ in zip(units, labels, full, strict=True) if own != all_
        }
        bound = upper_bound(len(differing), len(set(units)), decision.confidence)
        if bound > decision.disagreement:
            break
        found = {"confidence_threshold": threshold, "disagreement": bound}
    if not found:
        log.warning(
            "The validation fold has too few samples, or too many differing decisions, to bound "
            "these by decision.disagreement=%g; decision.confidence_threshold=%g is used as it is.",
            decision.disagreement, decision.confidence_threshold,
        )  # fmt: skip
    return found


def _labels(classifier: SurfaceClassifier, samples: Sequence[Sample], store: Store) -> list[int]:
    return [classify_sample(classifier, sample, store)[0].label for sample in samples]


def upper_bound(count: int, samples: int, confidence: float) -> float:
    """One-sided upper Clopper-Pearson bound on a share of which ``count`` were seen."""
    interval = binomtest(count, samples, alternative="less").proportion_ci(confidence)
    return float(interval.high)
