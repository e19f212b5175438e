"""Check whether a checkpoint can call recordings unknown, and at which rates."""

import logging

from tex_lightning.classifier.card import Card
from tex_lightning.decision.calibration import LABEL, least_rate
from tex_lightning.errors import UserError

log = logging.getLogger(__name__)


def check_unknown(card: Card, described: bool) -> None:
    """Refuse ``decision.unknown`` for a checkpoint without novelties; warn if it has few.

    Args:
        card: As it is to decide.
        described: Whether there are statistics of its features.

    Raises:
        UserError: Saying what it lacks.
    """
    if not card.unknown:
        return
    if card.baseline:
        raise UserError(
            f"decision.unknown needs features of a network, and {card.title} is none; set "
            "decision.reject_below instead."
        )
    if not described:
        raise UserError(
            f"This {card.title} keeps no statistics of its features, which decision.unknown needs; "
            "train it anew with this version, or set decision.unknown=0."
        )
    if LABEL in card.classes:
        raise taken("The checkpoint knows")
    if not card.novelties:
        raise UserError(
            f"This {card.title} was trained without a validation fold, so decision.unknown has "
            "nothing to be set by; train with data.val_fold=1, or set decision.unknown=0."
        )
    warn_of_few(card)


def taken(whose: str) -> UserError:
    """The message for a class whose name is that of unknown recordings."""
    return UserError(
        f"{whose} a class named {LABEL}, the label that decision.unknown gives; rename the class, "
        "or set decision.unknown=0."
    )


def warn_of_few(card: Card) -> None:
    """Warn if there are too few known recordings to guarantee the requested rate."""
    count = len(card.known_novelties)
    if card.unknown_above is not None and least_rate(count) > card.unknown:
        log.warning(
            "decision.unknown=%g: %d known recordings promise no rate below %.3f; what is more "
            "unlike the training than all of them is called unknown.",
            card.unknown, count, least_rate(count),
        )  # fmt: skip
