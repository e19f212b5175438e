"""Checks of every value inside the nodes that name classes.

A value is held against the range that the schema gives its key, wherever that key stands, and
against the annotation of the class that takes it. Arguments that are no key of ``model`` or
``data`` have their ranges here, by name.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from tex_lightning.config import READS, Config, DataConfig, ModelConfig
from tex_lightning.config.instantiation import TARGET, find_callable, missing_library
from tex_lightning.config.keys import (
    Key,
    annotations,
    beyond,
    fits,
    in_words,
    key,
    nearest,
    parameters,
    walk_types,
)
from tex_lightning.config.model import LARGEST
from tex_lightning.errors import shorten

COUNT = {"least": 1, "most": 1_000_000}
SOME = {"least": 1, "most": 4096}
POSITIVE = {"above": 0, "most": 1_000_000}


@dataclass
class PartArguments:
    """Arguments beside the keys of ``model`` and ``data``."""

    # decoders
    channel: int | None = key(
        "channel of a sound, or column of a table beside its time, counted from 0; null reads all",
        least=0, most=4096,
    )  # fmt: skip
    # optimisers
    weight_decay: float = key("decay of the weights in a step", least=0, most=10)
    # features and networks
    windows: list[float] = key(
        "lengths of the windows", filled=True, unit="s", least=0.001, most=10
    )
    bands_per_octave: int = key("bands in an octave", least=1, most=96)
    thresholds: int = key("thresholds of a band", least=1, most=64)
    fragment_seconds: float = key("length of a fragment", unit="s", least=0.01, most=600)
    # baselines
    highest_hz: float = key("upper end of the filters", unit="Hz", above=0, most=500_000)
    filters: int = key("number of filters", least=1, most=1000)
    spacing: str = key("how filters follow each other", choices=("mel", "decreasing"))
    first: int = key("first cepstral coefficient", least=1, most=1000)
    last: int = key("last cepstral coefficient", least=1, most=1000)
    components: int = key("Gaussians of a mixture", **SOME)
    min_variance: float = key("smallest variance of a Gaussian", above=0, most=1000)
    patches: int = key("patches that the filters are learnt from", **COUNT)
    sparsity: float = key("mean activation of the auto-encoder", above=0, below=1)
    max_side: int = key(
        "largest side of a photo; larger ones are made smaller",
        unit="pixels", least=32, most=LARGEST,
    )  # fmt: skip
    scales: list[float] = key(
        "sizes of a photo, as exponents of two", filled=True, least=-8, most=4
    )
    photos: int = key("photos that the Gaussians are fitted to", **COUNT)
    descriptors: int = key("descriptors of each of these photos", **COUNT)
    cost: float = key("C of the support vector machines", **POSITIVE)
    strengths: list[float] = key("values of C to choose from", filled=True, **POSITIVE)
    radii: list[int] = key("radii of the patterns", filled=True, unit="pixels", least=1, most=64)
    kernels: int = key("number of features", least=84, most=1_000_000)
    threads: int = key("threads of the fit", least=1, most=1024)
    hydra_kernels: int = key("kernels of a group", **SOME)
    hydra_groups: int = key("groups at every dilation", **SOME)


RANGED = ("tex_lightning.", "torch.")  # whose classes take keys of the schema in their meaning
FITTED = ("optimizer", "schedule", "augmentation")


def check_nodes(config: Config) -> Iterator[str]:
    """Complaints about the nodes that the task reads."""
    reads, model = READS[config.task], config.model
    yield from check_node("data.reader", config.data.reader)
    if "model" in reads and model.baseline is not None:
        # check_model complains of anything else, and whoever makes it of a missing library
        if isinstance(model.baseline, Mapping) and missing_library(model.baseline) is None:
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
    for argument, value in node.items():
        name = f"{where}.{argument}"
        if str(argument).startswith("_"):  # Hydra's
            continue
        if taken is not None and argument not in taken:
            near = nearest(str(argument), taken, f"{where}.")
            yield f"{name} is no argument of {node[TARGET]}{near}: leave it out"
        elif isinstance(value, Mapping):
            yield from check_node(name, value)
        elif taken is not None and value == taken[argument].default:
            continue
        elif argument in kinds and not fits(value, kinds[argument]):
            yield f"{name} is {shorten(repr(value))}: give {in_words(kinds[argument])}"
        elif ranged:
            yield from _out_of_range(name, value, typed=argument in kinds)


def _signature(where: str, node: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Return the types and the parameters of what a node names."""
    if TARGET not in node:
        return {}, None
    called = find_callable(where, node)
    return annotations(called), parameters(called)


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
        for name, declared, kind in walk_types(section):
            leaf = name.rpartition(".")[2]
            found[leaf] = (*found.get(leaf, ()), (declared, kind))
    return found
