"""The result of a prediction, and whether a checkpoint can call a sample unknown."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from tex_lightning.classifier.card import LABEL, Card, least_rate
from tex_lightning.classifier.vote import Vote
from tex_lightning.errors import UserError
from tex_lightning_runtime.quality import Quality

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Prediction:
    """The prediction for a sample, or for a recording so far.

    If an input has a warning, the training had no such inputs: half of the votes and probabilities
    is then spread evenly over the classes, or all of them if nothing was measured.

    Attributes:
        label: Name of the class, or ``unknown``; None if there is no fragment yet.
        rejected: Whether the novelty is above its threshold; None without ``decision.unknown``.
        probability: Mean probability of the label over all fragments, 0 to 1.
        confidence: Confidence in the label, 0 to 1: its share of the fragment votes, or with the
            rules ``mean`` and ``score`` its probability.
        top_k: ``label`` and ``share`` of the best classes, the label first; ``share`` is the
            confidence in each.
        fragments: Number of fragments.
        relative_macs: Computed MACs as a share of those of the full decision.
        warnings: Faults of the input, one sentence each.
        modalities: Modalities that a FusionNet looked at; empty for other networks.
        latency_ms: Time from file or array to label in milliseconds.
        novelty: Distance to the closest class, from 0 to 2 for each sense; None without
            ``decision.unknown``, or where a sequential decision left out a sense.
        probabilities: Mean probability of each class by name; they sum to 1.

    Example:
        >>> import tex_lightning as tl
        >>> found = tl.load("RUN").predict(haptic="A.wav", image="B.jpg")
        >>> found.label in ("a", "b", "c"), found.fragments, found.modalities
        (True, 50, ('haptic', 'image'))
    """

    label: str | None
    rejected: bool | None
    probability: float | None
    confidence: float | None
    top_k: tuple[dict[str, Any], ...]
    fragments: int
    relative_macs: float
    warnings: tuple[str, ...]
    modalities: tuple[str, ...]
    latency_ms: float
    novelty: float | None = None
    probabilities: dict[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, without those that do not apply to this sample."""
        values, empty = {**vars(self)}, {"rejected", "modalities", "novelty"}
        # copies by hand: those of asdict take as long as the label where there are many classes
        values["top_k"] = tuple({**best} for best in self.top_k)
        values["probabilities"] = {**self.probabilities}
        left_out = {name for name in empty if values[name] in (None, ())}
        return {name: value for name, value in values.items() if name not in left_out}


def make_prediction(
    vote: Vote | None,
    card: Card,
    quality: Quality,
    top_k: int,
    latency: float,
    modalities: Sequence[str] = (),
) -> Prediction:
    """Make a prediction from a vote, None where there is no fragment yet.

    It lists the best ``top_k`` classes. ``latency`` is the time from input to label in seconds, and
    ``modalities`` are those that a FusionNet used.
    """
    threshold = card.unknown_above
    told: dict[str, Any] = {
        "warnings": tuple(quality.warnings),
        "modalities": tuple(modalities),
        "latency_ms": round(latency * 1000, 3),
    }
    if vote is None:
        rejected = None if threshold is None else False
        return Prediction(None, rejected, None, None, (), 0, 1.0, **told)
    doubted = vote.doubted(quality.doubt)
    support, probable, classes = (
        doubted.support.tolist(), doubted.probabilities.tolist(), card.classes
    )  # fmt: skip
    # the label first whatever the tie, then the others by what decides, then as ties are broken
    ranked = sorted(
        range(len(classes)), key=lambda i: (i != doubted.label, -support[i], -probable[i], i)
    )
    novelty = None if threshold is None else doubted.novelty
    novel = threshold is not None and novelty is not None and novelty > threshold
    unknown = None if threshold is None else quality.empty or novel
    return Prediction(
        label=LABEL if unknown else classes[doubted.label],
        rejected=unknown,
        probability=doubted.probability,
        confidence=support[doubted.label],
        top_k=tuple({"label": classes[i], "share": support[i]} for i in ranked[:top_k]),
        fragments=len(doubted.fragments),
        relative_macs=round(vote.relative_macs, 6),
        novelty=novelty,
        probabilities=dict(zip(classes, probable, strict=True)),
        **told,
    )


def check_unknown(card: Card, described: bool) -> None:
    """Reject ``decision.unknown`` for a checkpoint without novelties; warn if it has few.

    Args:
        card: Card with the decision to check.
        described: Whether there are statistics of its features.

    Raises:
        UserError: Saying what it lacks.
    """
    if not card.unknown:
        return
    if LABEL in card.classes:
        raise name_conflict("The checkpoint knows")
    if card.baseline or not described or not card.novelties:
        raise UserError(
            "decision.unknown needs statistics of a network's features and recordings of a "
            f"validation fold, and this {card.title} has none; train a network with "
            "data.val_fold=1, or set decision.unknown=0."
        )
    warn_of_few(card)


def name_conflict(whose: str) -> UserError:
    """Return the error for a class whose name is that of unknown recordings."""
    return UserError(
        f"{whose} a class named {LABEL}, the label that decision.unknown gives; rename the class, "
        "or set decision.unknown=0."
    )


def warn_of_few(card: Card) -> None:
    """Warn if there are too few known recordings to guarantee the requested rate."""
    count = len(card.known_novelties)
    if card.unknown_above is not None and least_rate(count) > card.unknown:
        log.warning(
            "decision.unknown=%g: %d known recordings guarantee no rate below %.3f; what is more "
            "unlike the training than all of them is called unknown.",
            card.unknown, count, least_rate(count),
        )  # fmt: skip
