"""From the node of a baseline to the system itself; its library is imported here and not before."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from tex_lightning.config.instantiation import INSTALL, TARGET, make, missing_library
from tex_lightning.errors import UserError

if TYPE_CHECKING:
    from tex_lightning.baselines.base import Baseline

WHERE = "model.baseline"


def make_baseline(name: str, node: Mapping[str, Any], budget: float) -> "Baseline":
    """A baseline that is not fitted yet.

    Args:
        name: Name of the model, for messages.
        node: ``model.baseline``.
        budget: ``model.budget``.

    Raises:
        UserError: If a library is missing, or a key is unknown or of the wrong type.
    """
    if (library := missing_library(node)) is not None:
        raise UserError(f"model={name} needs {library}, which is not installed; run: {INSTALL}")
    made = make(WHERE, node)
    from tex_lightning.baselines.base import Baseline

    if not isinstance(made, Baseline):
        raise UserError(
            f"{WHERE} names {node[TARGET]}, which is no baseline; derive it from "
            f"{Baseline.__module__}.{Baseline.__name__}."
        )
    return made.with_budget(budget) if budget != 1 else made
