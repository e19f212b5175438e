"""Checks of every value inside the nodes that name classes.

A value is held against the range that the schema gives its key, wherever that key stands, and
against the annotation of the class that takes it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from functools import cache
from typing import Any

from tex_lightning.config import READS, Config, DataConfig, ModelConfig
from tex_lightning.config.annotations import annotations, fits, in_words, parameters
from tex_lightning.config.check_ranges import beyond, nearest
from tex_lightning.config.instantiation import TARGET, find_callable
from tex_lightning.config.keys import Key, walk_types
from tex_lightning.config.parts import PartArguments
from tex_lightning.errors import shorten

RANGED = ("tex_lightning.", "torch.")  # whose classes take keys of the schema in their meaning
FITTED = ("optimizer", "schedule", "augmentation")


def check_nodes(config: Config) -> Iterator[str]:
    """Complaints about the nodes that the task reads."""
    reads, model = READS[config.task], config.model
    yield from check_node("data.reader", config.data.reader)
    if "model" in reads and model.baseline is not None:
        if isinstance(model.baseline, Mapping):  # check_model complains of anything else
            yield from check_node("model.baseline", model.baseline)
    elif "model" in reads:
        for sense in model.senses:
            yield from _inner_nodes(f"model.{sense}", model.sense(sense).node)
        for kind in model.trained:
            fit = model.fit_values(kind)
            nodes = {name: fit[name] for name in FITTED if name in fit}
            yield from _inner_nodes(f"model.{kind}.fit", nodes)
    for section in ("callbacks", "logger"):
        if section in reads:
            yield from _inner_nodes(section, getattr(config, section))
    if "trainer" in reads:
        yield from _inner_nodes("trainer", {"strategy": config.trainer.strategy})


def _inner_nodes(where: str, values: Mapping[str, Any]) -> Iterator[str]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from check_node(f"{where}.{name}", value)


def check_node(where: str, node: Mapping[str, Any]) -> Iterator[str]:
    """Complaints about the arguments of one node, and about the nodes inside it.

    Raises:
        UserError: If it names no class.
    """
    kinds, taken = _signature(where, node)
    ranged = str(node.get(TARGET, RANGED[0])).startswith(RANGED)
    for key, value in node.items():
        name = f"{where}.{key}"
        if str(key).startswith("_"):  # Hydra's
            continue
        if taken is not None and key not in taken:
            near = nearest(str(key), taken, f"{where}.")
            yield f"{name} is no argument of {node[TARGET]}{near}: leave it out"
        elif isinstance(value, Mapping):
            yield from check_node(name, value)
        elif taken is not None and value == taken[key].default:
            continue
        elif key in kinds and not fits(value, kinds[key]):
            yield f"{name} is {shorten(repr(value))}: give {in_words(kinds[key])}"
        elif ranged:
            yield from _out_of_range(name, value, typed=key in kinds)


def _signature(where: str, node: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Types and parameters of what a node names; a dataclass checks its own when it is made."""
    if TARGET not in node:
        return {}, None
    called = find_callable(where, node)
    return annotations(called), None if is_dataclass(called) else parameters(called)


def _out_of_range(name: str, value: object, *, typed: bool) -> Iterator[str]:
    """A value that the schema's key of that name does not allow, or any of several."""
    meant = known_keys().get(name.rpartition(".")[2], ())
    complaints = [[*_refused(name, value, key, None if typed else kind)] for key, kind in meant]
    if complaints and all(complaints):
        yield from complaints[0]


def _refused(name: str, value: object, key: Key, kind: Any) -> Iterator[str]:  # noqa: ANN401
    if kind is not None and not fits(value, kind):
        yield f"{name} is {shorten(repr(value))}: give {in_words(kind)}"
    else:
        yield from beyond(name, value, key)


@cache
def known_keys() -> dict[str, tuple[tuple[Key, Any], ...]]:
    """Keys that classes take as arguments, with their types, by the last part of their name."""
    found: dict[str, tuple[tuple[Key, Any], ...]] = {}
    for section in (ModelConfig, DataConfig, PartArguments):
        for name, key, kind in walk_types(section):
            leaf = name.rpartition(".")[2]
            found[leaf] = (*found.get(leaf, ()), (key, kind))
    return found
