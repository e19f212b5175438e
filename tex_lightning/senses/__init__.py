"""Branches: one sense each, with how its files are decoded, its features and its network."""

from collections.abc import Mapping
from typing import Any

from torch import nn

from tex_lightning.config.instantiation import TARGET, make, make_value, trusted_class
from tex_lightning.errors import UserError, shorten
from tex_lightning.senses.base import Sense

__all__ = ["Sense", "make_sense"]

BUILT = (TARGET, "features", "network")


def make_sense(name: str, node: Mapping[str, Any], classes: int) -> Sense:
    """Make a sense of a card with random weights.

    Args:
        name: Name of the sense.
        node: ``_target_``, a subclass of :class:`Sense`; ``modality``; ``decode``, arguments of
            its decoder; ``features`` and ``network``, each a ``_target_`` with arguments. All
            other values are offered to these two, which take what they have parameters for,
            beside ``classes``, the settings of the decoder and, for the network, the ``bands`` that
            the features say they have; nodes with a ``_target_`` are built
            before.
        classes: Number of materials.

    Raises:
        UserError: If the node cannot be used, or names a class that is not trusted.
    """
    where = f"model.{name}"
    cls = trusted_class(where, node)
    if not issubclass(cls, Sense):
        raise UserError(
            f"{where} names {node[TARGET]}, which is no sense; take "
            "tex_lightning.senses.signal.SignalSense or "
            "tex_lightning.senses.photo.PhotoSense, or derive from one of them."
        )
    rest = {key: value for key, value in node.items() if key not in BUILT}
    nodes = {
        key: each for key, each in rest.items() if isinstance(each, Mapping) and TARGET in each
    }
    values = make_value(where, {key: value for key, value in rest.items() if key not in nodes})
    modality, decode = values.pop("modality"), values.pop("decode")
    offered = {**decode, "classes": classes, **values}
    for key, value in nodes.items():
        offered[key] = make(f"{where}.{key}", value, **offered)
    features = _make_part(f"{where}.features", node["features"], offered)
    if (bands := getattr(features, "bands", None)) is not None:
        offered["bands"] = bands
    network = _make_part(f"{where}.network", node["network"], offered)
    if not callable(getattr(network, "features", None)):
        raise UserError(
            f"{where}.network names {node['network'][TARGET]}, which has no method "
            "features(x, level); add one that gives class scores at level fc3."
        )
    return cls(name, modality, cls.make_decoder(decode), features, network)


def _make_part(where: str, node: Mapping[str, Any], offered: Mapping[str, Any]) -> nn.Module:
    part = make(where, node, **offered)
    if not isinstance(part, nn.Module):
        raise UserError(f"{where} gives {shorten(part)}, which is no nn.Module.")
    return part
