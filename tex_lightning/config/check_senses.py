"""Checks of the keys of a user's senses: none may be passed over in silence."""

import logging
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from difflib import get_close_matches
from typing import Any

from tex_lightning.config.annotations import parameters
from tex_lightning.config.check_ranges import nearest
from tex_lightning.config.instantiation import OWN, TARGET, find_callable, find_class
from tex_lightning.config.model import (
    CustomPhotoConfig,
    CustomSignalConfig,
    ModelConfig,
    PhotoConfig,
    SenseConfig,
    SignalConfig,
)
from tex_lightning.errors import listed, shorten

log = logging.getLogger(__name__)

BRANCH = {each.name for each in fields(SenseConfig)}
BASES = {CustomSignalConfig: SignalConfig, CustomPhotoConfig: PhotoConfig}
PARTS = ("features", "network")
CHECKPOINT = "_checkpoint"
FILLED_IN = ("classes", "bands")  # with what the data and the features say
MISSPELT = 0.8  # similarity of two exchanged letters among five
WITH_BANDS = {"skip_impact"}  # of conf/sense/bands.yaml, whose features may be replaced


def check_senses(model: ModelConfig) -> Iterator[str]:
    """Complaints about keys that nothing reads: of a user's senses, and of their checkpoints."""
    for key in vars(model.fusion):
        sense = key.removesuffix(CHECKPOINT)
        if sense != key and sense not in model.known:
            near = nearest(key, [f"{name}{CHECKPOINT}" for name in model.known], "model.fusion.")
            yield f"model.fusion.{key} is of no sense{near}: name one of {', '.join(model.known)}"
    for sense in model.senses if model.baseline is None else ():
        branch = model.sense(sense)
        if type(branch) in BASES:
            yield from _check_sense(f"model.{sense}", branch)
        else:
            decoder = _decoder_keys(find_class(f"model.{sense}", branch.node))
            yield from _unread(f"model.{sense}.decode", branch.decode, decoder, {})


def _check_sense(where: str, sense: SenseConfig) -> Iterator[str]:
    """Complaints about one sense: the keys of its classes, its own, those of its decoder."""
    values = sense.node
    nodes = {
        name: node
        for name, node in values.items()
        if name in PARTS or (isinstance(node, dict) and TARGET in node)
    }
    taken = {name: _parameters(f"{where}.{name}", node) for name, node in nodes.items()}
    if None in taken.values():  # a class that takes any argument
        return
    # what a class is given in its own node wins
    offered = {key for name, all_of in taken.items() for key in (all_of or set()) - {*nodes[name]}}
    offered -= {*FILLED_IN}
    inner = {key: f"{name}.{key}" for name, node in nodes.items() for key in node}
    known = BRANCH | _inherited(sense) | (offered - {*values["decode"]})
    # what a node has as well may be interpolated from here
    known |= {key for node in nodes.values() for key in node if values.get(key) == node[key]}
    doubtful = [key for key in values if _resembles(key, known | {*inner})]
    yield from _unread(where, doubtful, known, inner)
    for key in {*values} - {*doubtful} - known:
        log.warning("%s.%s is read by no class of this sense.", where, shorten(key))
    decoder = _decoder_keys(find_class(where, values))
    if decoder is not None:
        yield from _unread(f"{where}.decode", values["decode"], decoder | offered, {})


def _resembles(key: str, names: Iterable[str]) -> bool:
    """Whether a key is or may be meant to be one of these names."""
    return bool(get_close_matches(key, list(names), n=1, cutoff=MISSPELT))


def _unread(
    where: str, given: Iterable[str], known: set[str] | None, elsewhere: Mapping[str, str]
) -> Iterator[str]:
    """A complaint about each key that is not known, or known elsewhere; None knows all."""
    if known is None:
        return
    names = {name: name for name in sorted(known)}
    for key in map(str, given):
        if key not in names and not key.startswith("_"):
            near = get_close_matches(key, spelled := {**elsewhere, **names}, n=1)
            meant = f" (did you mean {where}.{spelled[near[0]]}?)" if near else ""
            shown = [name for name in names if not name.startswith("_")]
            yield f"{where}.{shorten(key)} is read by no class{meant}: {where} has {listed(shown)}"


def _parameters(where: str, node: Mapping[str, Any]) -> set[str] | None:
    """Names that a class takes; None if it takes any, or does not say."""
    taken = parameters(find_callable(where, node))
    return None if taken is None else {*taken}


def _inherited(sense: SenseConfig) -> set[str]:
    """Keys that come with a sense of the package which the user's begins with, read or not."""
    base = {each.name for each in fields(BASES[type(sense)])} - BRANCH
    given = vars(sense).keys()
    return base if base <= given else WITH_BANDS & given


def _decoder_keys(cls: type[Any]) -> set[str] | None:
    """Settings that the decoder of a sense has; None if a user's sense reads them by itself."""
    make = getattr(cls, "make_decoder", None)
    if make is None or not make.__module__.startswith(OWN):
        return None
    return {each.name for each in fields(make.__annotations__["return"])}
