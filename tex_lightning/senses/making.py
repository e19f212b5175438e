"""How a sense is made from its settings."""

from collections.abc import Mapping
from typing import Any

from torch import nn
from torch.nn.parameter import is_lazy

from tex_lightning.config.instantiation import make, make_value, trusted_class
from tex_lightning.config.nodes import OF_FEATURES
from tex_lightning.config.signatures import TARGET
from tex_lightning.data.decode import check_decoding
from tex_lightning.errors import UserError, shorten
from tex_lightning.senses.base import Sense

BUILT = (TARGET, "features", "network")


def make_sense(name: str, node: Mapping[str, Any], classes: int) -> Sense:
    """Make a sense with random weights from its settings.

    Args:
        name: Name of the sense.
        node: ``_target_``, a subclass of :class:`Sense`; ``modality``; ``decode``, arguments of
            its decoder; ``features`` and ``network``, each a ``_target_`` with arguments. Features
            and network also get those of all other keys that they have a parameter for, and
            likewise ``classes``, the settings of the decoder and, for the network, ``bands``,
            ``blocks`` and ``bins`` of the features. A key with a ``_target_`` is built first.
        classes: Number of classes.

    Raises:
        UserError: If the node cannot be used, or names a class that is not trusted.
    """
    where = f"model.{name}"
    if hasattr(nn.ModuleDict, name):
        raise UserError(f"No sense can be called {name}, as a method of PyTorch is; rename it.")
    cls = _sense_class(where, node)
    rest = {key: value for key, value in node.items() if key not in BUILT}
    nodes = {key: it for key, it in rest.items() if isinstance(it, Mapping) and TARGET in it}
    values = make_value(where, {key: value for key, value in rest.items() if key not in nodes})
    modality, decode = values.pop("modality"), values.pop("decode")
    check_decoding(f"{where}.decode", cls.medium, decode)
    offered = {**decode, "classes": classes, **values}
    for key, value in nodes.items():
        offered[key] = make(f"{where}.{key}", value, **offered)
    features = make(f"{where}.features", node["features"], **offered)
    _check_module(f"{where}.features", features)
    of_features = {key: getattr(features, key, None) for key in OF_FEATURES}
    offered |= {key: value for key, value in of_features.items() if value is not None}
    network = make(f"{where}.network", node["network"], **offered)
    _check_module(f"{where}.network", network)
    check_network(f"{where}.network", node["network"][TARGET], network)
    return cls(name, modality, cls.make_decoder(decode), features, network)


def _sense_class(where: str, node: Mapping[str, Any]) -> type[Sense]:
    """Return the class that the settings of a sense name.

    Raises:
        UserError: If it is no sense, or not trusted.
    """
    cls = trusted_class(where, node)
    if not issubclass(cls, Sense):
        raise UserError(
            f"{where} names {node[TARGET]}, which is no sense; take "
            "tex_lightning.senses.signal.SignalSense or "
            "tex_lightning.senses.photo.PhotoSense, or derive from one of them."
        )
    return cls


def _check_module(where: str, part: object) -> None:
    """Reject what is no module, or one whose sizes its first input decides."""
    if not isinstance(part, nn.Module):
        raise UserError(f"{where} gives {shorten(part)}, which is no nn.Module.")
    if any(map(is_lazy, part.parameters())):
        raise UserError(
            f"{where} has lazy layers, whose sizes a checkpoint would not say; give them their "
            "sizes, as in nn.Conv1d(50, 8, 3) for nn.LazyConv1d(8, 3)."
        )


def check_network(where: str, name: str, network: object) -> None:
    """Reject a network without the method that all have.

    Raises:
        UserError: If it has none.
    """
    if not callable(getattr(network, "features", None)):
        raise UserError(
            f"{where} names {name}, which has no method features(x, level); add one that gives "
            "class scores at level fc3."
        )
