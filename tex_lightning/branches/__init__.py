"""Branches: one sense each, with how its files are decoded, its features and its network."""

from collections.abc import Mapping
from typing import Any

from torch import nn

from tex_lightning.branches.base import Branch
from tex_lightning.config.instantiation import TARGET, build, find_class
from tex_lightning.errors import UserError, shorten

__all__ = ["Branch", "make_branch"]

OWN = (TARGET, "modality", "decode", "features", "network")


def make_branch(name: str, node: Mapping[str, Any], classes: int) -> Branch:
    """Make a branch with random weights.

    Args:
        name: Name of the sense.
        node: ``_target_``, a subclass of :class:`Branch`; ``modality``; ``decode``, arguments of
            its decoder; ``features`` and ``network``, each a ``_target_`` with arguments. All
            other values are offered to these two, which take what they have parameters for,
            beside ``classes``, the settings of the decoder and, for the network, the ``bands`` that
            the features say they have; nodes with a ``_target_`` are built
            before.
        classes: Number of materials.

    Raises:
        UserError: If the node cannot be used.
    """
    where = f"model.{name}"
    cls = find_class(where, node)
    if not issubclass(cls, Branch):
        raise UserError(
            f"{where} names {node[TARGET]}, which is no branch; take "
            "tex_lightning.branches.signal.SignalBranch or "
            "tex_lightning.branches.photo.PhotoBranch, or derive from one of them."
        )
    offered = {**node["decode"], "classes": classes}
    offered |= {key: value for key, value in node.items() if key not in OWN}
    for key, value in list(offered.items()):
        if isinstance(value, Mapping) and TARGET in value:
            offered[key] = build(f"{where}.{key}", value, **offered)
    features = _make_part(f"{where}.features", node["features"], offered)
    if (bands := getattr(features, "bands", None)) is not None:
        offered["bands"] = bands
    network = _make_part(f"{where}.network", node["network"], offered)
    if not callable(getattr(network, "features", None)):
        raise UserError(
            f"{where}.network names {node['network'][TARGET]}, which has no method "
            "features(x, level); add one that gives class scores at level fc3."
        )
    return cls(name, node["modality"], cls.make_decoder(node["decode"]), features, network)


def _make_part(where: str, node: Mapping[str, Any], offered: Mapping[str, Any]) -> nn.Module:
    part = build(where, node, **offered)
    if not isinstance(part, nn.Module):
        raise UserError(f"{where} gives {shorten(part)}, which is no nn.Module.")
    return part
