"""From a ``_target_`` of the configuration to the object that it names: the only place for it."""

import inspect
from collections.abc import Mapping
from typing import Any

from hydra.errors import InstantiationException
from hydra.utils import get_class, instantiate

from tex_lightning.errors import UserError

TARGET = "_target_"


def build(where: str, node: Mapping[str, Any], **offered: Any) -> Any:  # noqa: ANN401
    """Build the object that a node of the configuration names.

    Args:
        where: The node's key, for messages.
        node: ``_target_`` and arguments, which may be such nodes again.
        offered: Further arguments, of which those are passed that the class takes and the node
            does not give.

    Raises:
        UserError: If the class does not exist, lacks a library, or refuses the arguments.
    """
    if TARGET not in node:
        raise UserError(
            f"{where} has no _target_; name the class there, as in package.module.Name."
        )
    try:
        taken = inspect.signature(get_class(node[TARGET])).parameters if offered else {}
        more = {key: value for key, value in offered.items() if key in taken and key not in node}
        return instantiate({"_convert_": "all", **node}, **more)
    except UserError:
        raise
    except Exception as error:  # a class of the user's may fail in any way
        raise UserError(f"{where} cannot be made: {_reason(error)}") from error


def call(where: str, made: Any, *arguments: object) -> Any:  # noqa: ANN401
    """Call what a node with ``_partial_: true`` gave.

    Raises:
        UserError: If it was no such node, or the call fails.
    """
    if not callable(made):
        raise UserError(f"{where} gives an object where a call is needed; add _partial_: true.")
    try:
        return made(*arguments)
    except Exception as error:  # a class of the user's may fail in any way
        raise UserError(f"{where} cannot be made: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    """The innermost cause in one line."""
    while isinstance(error, InstantiationException) and isinstance(error.__cause__, Exception):
        error = error.__cause__
    said = " ".join(str(error).split()).rstrip(".")
    return f"{said or type(error).__name__}; correct its _target_ or arguments."
