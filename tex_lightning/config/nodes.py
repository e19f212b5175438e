"""Nodes of the configuration that name a class: their keys, and keys that a sense shares.

The signature of the class is their schema. It is read before PyTorch is imported where the source
says it (:mod:`.static_signatures`); other classes are checked when they are built.
"""

from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from inspect import Signature
from typing import Any

from tex_lightning.config.keys import Key, hints_of, without_extras
from tex_lightning.config.signatures import HYDRAS, TARGET, converted, misfits, strangers
from tex_lightning.config.static_signatures import read_signature

OF_FEATURES = ("bands", "blocks", "bins")  # attributes that a network takes from features
OFFERED = ("classes", *OF_FEATURES)  # to the classes of a sense, beside its keys
Node = Mapping[str, Any]


def is_node(value: object) -> bool:
    """Return whether a value names a class."""
    return isinstance(value, Mapping) and isinstance(value.get(TARGET), str)


def arguments(node: Node) -> dict[str, Any]:
    """Return what a node gives to its class."""
    return {name: value for name, value in node.items() if name not in HYDRAS}


def node_complaints(where: str, node: Node) -> Iterator[str]:
    """Yield the errors of a node, as far as the source of its class tells them."""
    signature = read_signature(node[TARGET]) if is_node(node) else None
    if signature is not None:
        yield from strangers(where, signature, arguments(node))
        yield from misfits(where, signature, converted(signature, arguments(node)))


def takers(sense: Node, *classes: str) -> Iterator[tuple[Node, Signature | None]]:
    """Yield nodes of a sense, and of further classes, that take its keys, with signatures."""
    for node in [*filter(is_node, sense.values()), *({TARGET: name} for name in classes)]:
        yield node, read_signature(node[TARGET])


def shared_complaints(where: str, sense: Node, *classes: str) -> Iterator[str]:
    """Yield a complaint for each key of a sense that a class does not take so."""
    for node, signature in takers(sense, *classes):
        if signature is not None:
            shared = {name: value for name, value in sense.items() if name not in node}
            yield from misfits(where, signature, converted(signature, shared))


def as_taken(sense: Node) -> dict[str, Any]:
    """Return the keys of a sense, a whole number as the classes want it where they want others."""
    values = dict(sense)
    for _, signature in takers(sense):
        values |= {} if signature is None else converted(signature, values)
    return values


def takes(sense: Node, name: str, *classes: str) -> bool:
    """Return whether a class of a sense, or another of the given ones, has a key.

    A class whose source cannot be read may have any.
    """
    found = [signature for _, signature in takers(sense, *classes)]
    return name not in (*OFFERED, *sense["decode"]) and any(
        signature is None or name in signature.parameters for signature in found
    )


def walk(section: type[Any], values: Node, prefix: str = "") -> Iterator[tuple[str, Key]]:
    """Yield dotted names and keys of a section, then those of the sections in it.

    Args:
        section: Its dataclass.
        values: What is composed of it; keys of classes are those of the classes named there.
        prefix: Its own name, with a dot.
    """
    hints = hints_of(section)
    for name, hint in hints.items():
        if (key := Key.of(hint)).meaning:
            yield f"{prefix}{name}", key
    nodes = {name: node for name, node in values.items() if is_node(node)}
    for _, signature in takers(values):
        shared = {name: value for name, value in values.items() if name not in hints}
        yield from _keys_of(signature, shared, prefix)
    for name, node in nodes.items():
        yield from _keys_of(read_signature(node[TARGET]), node, f"{prefix}{name}.")
    for name, hint in hints.items():
        kind = without_extras(hint)
        if isinstance(kind, type) and is_dataclass(kind):
            yield from walk(kind, values.get(name) or {}, f"{prefix}{name}.")


def _keys_of(signature: Signature | None, values: Node, prefix: str) -> Iterator[tuple[str, Key]]:
    """Yield the keys among some values that a class gives a meaning."""
    for name, parameter in signature.parameters.items() if signature else ():
        if name in values and (key := Key.of(parameter.annotation)).meaning:
            yield f"{prefix}{name}", key
