"""Branches: one sense each, with how its files are decoded, its features and its network."""

from collections.abc import Mapping
from typing import Any

from tex_lightning.branches.base import Branch
from tex_lightning.config.instantiation import TARGET, find_class
from tex_lightning.errors import UserError

__all__ = ["Branch", "make_branch"]


def make_branch(name: str, node: Mapping[str, Any], classes: int) -> Branch:
    """Make a branch with random weights.

    Args:
        name: Of the sense.
        node: ``_target_``, a subclass of :class:`Branch`, and its arguments.
        classes: Number of materials.

    Raises:
        UserError: If the node cannot be used.
    """
    cls = find_class(f"model.{name}", node)
    if not issubclass(cls, Branch):
        raise UserError(
            f"model.{name} names {node[TARGET]}, which is no branch; take "
            "tex_lightning.branches.signal.SignalBranch or "
            "tex_lightning.branches.photo.PhotoBranch, or derive from one of them."
        )
    values = {key: value for key, value in node.items() if key != TARGET}
    return cls.make(name, classes, **values)
