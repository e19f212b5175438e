"""What features and networks have to give; a fault in a user's own is said in one sentence.

Faults of this package's parts keep their traceback.
"""

import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from torch import Tensor, nn

from tex_lightning.errors import UserError, reason
from tex_lightning.networks.blocks import score_layer_of

OWN = "tex_lightning"
KNOWN = {OWN, "torch", "kornia"}  # whose classes its parts consist of
PACKAGE = Path(__file__).parents[1]


class PartFault(UserError):
    """A user's features or network fail, or give what the package cannot use."""


def is_own(*parts: nn.Module) -> bool:
    """Whether the classes of all parts are this package's, and nothing in them is a user's."""
    return all(_package(part) == OWN and _culprit(part) is part for part in parts)


def _package(part: nn.Module) -> str:
    return type(part).__module__.partition(".")[0]


def _culprit(part: nn.Module) -> nn.Module:
    """What a fault is blamed on: the outermost of a user's modules in a part, or the part."""
    return next((each for each in part.modules() if _package(each) not in KNOWN), part)


def culprit_name(part: nn.Module) -> str:
    """Name of the class that a fault in a part is blamed on, which may be a user's within it."""
    return type(_culprit(part)).__name__


@contextmanager
def blamed(part: nn.Module, sense: str, *fed_by: nn.Module) -> Iterator[None]:
    """Name a user's part that raises any error.

    Errors of this package's parts pass, and those that its own code raises wherever it is called.

    Args:
        part: Features or network that are called.
        sense: Name of the sense that they belong to.
        fed_by: Parts that gave what it is called with, which may be at fault instead.

    Raises:
        PartFault: From any other error.
    """
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        *_, innermost = traceback.extract_tb(error.__traceback__)
        if is_own(part, *fed_by) or Path(innermost.filename).is_relative_to(PACKAGE):
            raise
        theirs = [each for each in (part, *fed_by) if not is_own(each)]
        given = "".join(f" on what {culprit_name(each)} gives" for each in fed_by if each in theirs)
        raise PartFault(
            f"{_name(part, sense)} raised {type(error).__name__}{given}: {reason(error)}; correct "
            f"{' or '.join(map(culprit_name, theirs))}."
        ) from error


def check_input(found: object, features: nn.Module, sense: str, batch: int, medium: str) -> None:
    """Refuse what a user's features give if it is no network input.

    Args:
        found: What they gave.
        features: They.
        sense: Name of their sense.
        batch: How many recordings, or pieces of them, they were given.
        medium: What these are: ``signal`` or ``photo``.

    Raises:
        PartFault: Saying what it is and what is expected.
    """
    layout, least = (
        ("(1, ..., frames)", 2)
        if medium == "signal"
        else (f"({batch}, channels, height, width)", 4)
    )
    if not _is_batch(found, batch, least):
        raise _unexpected(found, features, sense, layout)


def check_output(found: object, network: nn.Module, sense: str, batch: int) -> None:
    """Refuse what ``features(x, level)`` of a user's network gives if it is no dense output.

    Raises:
        PartFault: As :func:`check_input`.
    """
    if not _is_batch(found, batch, 3):
        raise _unexpected(found, network, sense, f"({batch}, D, *positions)")


def check_scores(network: nn.Module, sense: str, scores: Tensor, classes: int) -> None:
    """Refuse a network that does not score every class.

    Args:
        network: It.
        sense: Name of its sense.
        scores: (scores, positions) that it gives at level "fc3".
        classes: How many there have to be.

    Raises:
        PartFault: Saying how many it gives.
    """
    if len(scores) != classes:
        raise PartFault(
            f"{_name(network, sense)} gives {len(scores)} scores at each position, and there are "
            f"{classes} classes; give its last layer as many outputs as its argument classes says."
        )


def check_score_layer(network: nn.Module, sense: str, hidden: Tensor, classes: int) -> None:
    """Refuse a ``score_layer`` that does not lead from FC2 to the class scores.

    Args:
        network: A network that has one.
        sense: Name of its sense.
        hidden: (D, positions) that it gives at level "fc2".
        classes: Number of classes.

    Raises:
        PartFault: Saying what such a layer is.
    """
    layer = score_layer_of(network)
    assert layer is not None, "asked of a network that has one"
    if tuple(layer.weight.shape[:2]) != (classes, len(hidden)):
        rows, columns = layer.weight.shape[:2]
        raise PartFault(
            f"score_layer of {_name(network, sense)} turns {columns} features into {rows} scores, "
            f"and at level fc2 the network gives {len(hidden)} features, for {classes} classes; "
            'let features(x, "fc2") give what that layer takes, or give it another name.'
        )


def check_gradient(network: nn.Module, sense: str, scores: Tensor) -> None:
    """Refuse scores that a network cannot be trained by.

    Raises:
        PartFault: If they do not depend on weights that are to be trained.
    """
    if not scores.requires_grad:
        raise PartFault(
            f"The scores of {_name(network, sense)} carry no gradient, so nothing can be trained; "
            "compute them from its parameters, without detach() and no_grad()."
        )


def _is_batch(found: object, batch: int, least: int) -> bool:
    return (
        isinstance(found, Tensor)
        and found.dim() >= least
        and len(found) == batch
        and found.is_floating_point()
    )


def _unexpected(found: object, part: nn.Module, sense: str, layout: str) -> PartFault:
    given = type(found).__name__
    if isinstance(found, Tensor):
        kind = str(found.dtype).removeprefix("torch.")
        given = f"a tensor of {kind} of shape {tuple(found.shape)}"
    return PartFault(
        f"{_name(part, sense)} returned {given}, and a floating-point tensor of shape {layout} is "
        "expected; correct that class."
    )


def _name(part: nn.Module, sense: str) -> str:
    return f"{culprit_name(part)} of {sense}"
