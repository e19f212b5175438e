"""Calibrate a checkpoint's probabilities and thresholds on the validation fold."""

import logging
from collections.abc import Sequence
from dataclasses import replace

import torch
from scipy.stats import binomtest

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, DecisionConfig
from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import class_indices
from tex_lightning.data.store import Store, load_sample
from tex_lightning.decision.calibration import fit_temperature
from tex_lightning.evaluation.early_stopping import full_labels, sequential_votes
from tex_lightning.evaluation.pairing import scarcest
from tex_lightning.inference.early_stopping import SEQUENTIAL, needs_threshold
from tex_lightning.inference.engine import accelerate

log = logging.getLogger(__name__)


def calibrated_card(
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    store: Store,
    config: Config,
    *,
    fitted: bool = False,
) -> Card:
    """Return the card with the temperature, and the threshold of sequential decisions.

    Args:
        classifier: Trained, in evaluation mode.
        samples: Samples of the validation fold; without any the card stays as it is.
        store: Their recordings.
        config: How it runs and decides.
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
    if config.decision.name == SEQUENTIAL and needs_threshold(classifier):
        fast = accelerate(classifier, config.engine)
        fast.card = card
        found |= choose_confidence_threshold(fast, config.decision, samples, store)
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
    labels, units = full_labels(classifier, samples, store), independent(samples)
    found: dict[str, float] = {}
    for threshold in sorted(decision.confidence_thresholds, reverse=True):
        tried = replace(decision, calibrated=False, confidence_threshold=threshold)
        votes = sequential_votes(classifier, tried, samples, store)
        differing = {
            unit
            for unit, vote, label in zip(units, votes, labels, strict=True)
            if vote.label != label
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


def independent(samples: Sequence[Sample]) -> list[str]:
    """Return each sample's recording of the modality with the fewest recordings."""
    return scarcest(
        [{name: str(row.path) for name, row in each.recordings.items()} for each in samples]
    )


def upper_bound(count: int, samples: int, confidence: float) -> float:
    """One-sided upper Clopper-Pearson bound on a share of which ``count`` were seen."""
    interval = binomtest(count, samples, alternative="less").proportion_ci(confidence)
    return float(interval.high)
