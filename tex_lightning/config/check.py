"""Checks of a configuration beyond types: ranges, choices, and keys that need each other.

Ranges and choices of single keys stand in the schema. Everything is checked before any work, and
all complaints are made at once.
"""

import logging
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from difflib import get_close_matches
from operator import attrgetter
from typing import Any

from omegaconf import MISSING, DictConfig, OmegaConf

from tex_lightning.config import READ_FILES, Config, DataConfig, ModelConfig, TrainerConfig, flatten
from tex_lightning.config.check_nodes import check_nodes
from tex_lightning.config.check_tasks import AUTO, check_decision, check_task
from tex_lightning.config.instantiation import OWN, TARGET, find_callable, find_class
from tex_lightning.config.keys import (
    annotations,
    beyond,
    choice,
    fits,
    in_words,
    least,
    nearest,
    parameters,
    walk,
)
from tex_lightning.config.mistakes import unknown_key
from tex_lightning.config.model import (
    CustomPhotoConfig,
    CustomSignalConfig,
    PhotoConfig,
    SenseConfig,
    SignalConfig,
    SignalFitConfig,
)
from tex_lightning.errors import UserError, listed, shorten
from tex_lightning.perturbations.table import trainable

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


OWN_FLAGS = {
    "callbacks": "callbacks=[default,NAME]",
    "default_root_dir": "hydra.run.dir",
    "fast_dev_run": "debug=tiny",
    "logger": "logger=NAME",
    "max_epochs": "fit.epochs of the network",
    "plugins": "strategy",
    "use_distributed_sampler": "nothing: every process knows its share",
}


def check_data(data: DataConfig) -> Iterator[str]:
    """Complaints about ``data``."""
    for key in ("root", "manifest"):
        given = getattr(data, key)
        if given is not None and given not in data.reader.values():
            yield f"data.{key} is given, but data={data.name} does not read it: use data=folder"
    if data.resize is not None and data.half_scale:
        yield "data.half_scale and data.resize both decide the size of photos: turn one off"
    if data.inverted and data.test_fold is None:
        yield "data.inverted trains on data.test_fold, which is null: give its number"
    if data.group_by is not None and "group_by" not in data.reader:
        yield f"data.group_by is not read by data={data.name}: leave it out"
    if data.test_where is not None:
        yield from _test_where(data)
    for name in ("test_fold", "val_fold"):
        fold = getattr(data, name)
        if fold is not None and not 0 <= fold < data.folds:
            yield f"data.{name} is {shorten(fold)}: choose from 0 to {data.folds - 1}"
    if data.val_fold is not None and data.val_fold == data.test_fold:
        yield f"data.val_fold and data.test_fold are both {data.val_fold}: choose different folds"
    elif data.folds == 2 and None not in (data.test_fold, data.val_fold) and not data.inverted:
        yield "data.val_fold takes the only fold of two to train on: give data.val_fold=null"


def _test_where(data: DataConfig) -> Iterator[str]:
    where = data.test_where
    given = list(where.values()) if isinstance(where, dict) else []
    values = [item for each in given for item in (each if isinstance(each, list) else [each])]
    if not given or [] in given or any(isinstance(item, dict | list | None) for item in values):
        yield (
            f"data.test_where is {shorten(where)}: give names and values of conditions, as in "
            "{speed: 60} or {speed: [50, 60], light: lamp}"
        )
    if data.inverted:
        yield (
            "data.inverted tests all folds but one and data.test_where some conditions: leave "
            "data.test_where out, or give data.inverted=false"
        )


def check_model(model: ModelConfig) -> Iterator[str]:
    """Complaints about ``model``."""
    nodes = {
        "model.baseline": model.baseline,
        "model.visual.fit.augmentation": model.visual.fit.augmentation,
    }
    for key, node in nodes.items():
        if not isinstance(node, dict | None):
            yield f"{key} is {shorten(node)}: give a class and arguments, {{_target_: a.b.Name}}"
    if not model.senses or len(set(model.senses)) < len(model.senses):
        yield f"model.senses is {shorten(model.senses)}: name one sense or several, each once"
    if model.baseline is not None and len(model.senses) > 1:
        yield f"model={model.name} looks at one sense: give one in model.senses"
    head = list(model.visual.head)
    if len(head) not in (0, 2):
        given = shorten(head)
        yield f"model.visual.head is {given}: give channels of FC1 and FC2, or [] for neither"
    for sense in model.known:
        branch = model.sense(sense)
        medium = "signal" if isinstance(branch.fit, SignalFitConfig) else "photo"
        for name in branch.fit.perturb:
            known = trainable(branch.modality, medium)
            yield from choice(f"model.{sense}.fit.perturb", name, known)
        if branch.fit.epochs == 0 and not (sense == "visual" and not head):
            # what is fitted to all recordings at once is all there is
            network = find_class(f"model.{sense}.network", branch.network)
            fewest = 0 if hasattr(network, "fit") else 1
            yield from least(f"model.{sense}.fit.epochs", branch.fit.epochs, fewest)
    yield from check_senses(model)
    # and FusionNet's sum
    fewest = 0 if model.fusion.head_start == "scores" else 1
    yield from least("model.fusion.fit.epochs", model.fusion.fit.epochs, fewest)


def check_flags(flags: dict[str, Any]) -> Iterator[str]:
    """Flags that Lightning does not have, takes otherwise, or that this package sets by itself."""
    added = flags.keys() - {entry.name for entry in fields(TrainerConfig)}
    if not added:
        return
    from lightning import Trainer  # takes seconds, and a prediction does without

    known, kinds = parameters(Trainer) or {}, annotations(Trainer)
    for name in sorted(added):
        if name in OWN_FLAGS:
            yield f"trainer.{name} is set by this package: use {OWN_FLAGS[name]}"
        elif name not in known:
            near = nearest(name, known, "trainer.")
            yield f"trainer.{name} is no flag of Lightning's Trainer{near}: leave it out"
        elif not fits(flags[name], kinds.get(name)):
            yield f"trainer.{name} is {shorten(repr(flags[name]))}: give {in_words(kinds[name])}"


__all__ = ["AUTO", "check_config", "check_known", "check_missing", "check_shares"]


def check_missing(composed: DictConfig) -> None:
    """Refuse a configuration with open ``???`` values, naming all of them."""
    missing = missing_keys(composed)
    if missing:
        example = " ".join(f"{key}=VALUE" for key in missing)
        raise UserError(f"No value for {', '.join(missing)}; add {example} to the command.")


def missing_keys(composed: DictConfig) -> list[str]:
    """Dotted names of open ``???`` values; what refers to them is not open itself."""
    values: Any = OmegaConf.to_container(composed, resolve=False)
    return sorted(key for key, value in flatten(values).items() if value == MISSING)


def check_known(composed: DictConfig) -> None:
    """Refuse keys that were added with ``+`` and that nothing would read."""
    for key in _unknown(composed, OmegaConf.structured(Config), ""):
        given = OmegaConf.select(composed, key)
        inner = OmegaConf.to_container(given) if OmegaConf.is_dict(given) else given
        raise unknown_key(next(iter(flatten({key: inner}))), composed)


def _may_be_own(given: DictConfig, prefix: str, key: str) -> bool:
    """Whether a key is one of Lightning's, see ``check_flags``, or of a sense of the user's own."""
    if prefix == "model.":
        return OmegaConf.is_dict(given[key]) and TARGET in given[key]
    starts = prefix == "model.fusion." and key.endswith("_checkpoint")
    recording = not prefix and given.task in READ_FILES
    return prefix == "trainer." or starts or recording


def _unknown(given: DictConfig, known: DictConfig, prefix: str) -> Iterator[str]:
    for key in map(str, given):
        if key not in known.keys():  # noqa: SIM118  (`in known` is false for open values)
            if not _may_be_own(given, prefix, key):
                yield f"{prefix}{key}"
        elif OmegaConf.get_type(known, key) is dict:
            continue  # of classes that check them themselves
        elif OmegaConf.is_dict(known._get_node(key)) and not OmegaConf.is_missing(given, key):
            yield from _unknown(given[key], known[key], f"{prefix}{key}.")


def check_config(config: Config) -> None:
    """Refuse invalid values, naming all of them in one sentence."""
    complaints = [
        *check_ranges(config),
        *check_data(config.data),
        *check_model(config.model),
        *check_decision(config),
        *check_task(config),
        *check_flags(config.trainer.flags),
    ]
    complaints += check_nodes(config)
    if complaints:
        raise UserError("; ".join(complaints) + ".")


def check_ranges(config: Config) -> Iterator[str]:
    """Values outside the range or the choices that the schema gives for their key."""
    for name, key in walk(Config):
        yield from beyond(name, attrgetter(name)(config), key)


def check_shares(config: Config, processes: int) -> None:
    """Refuse batches that ``processes`` processes cannot share evenly.

    Raises:
        UserError: Naming the batch sizes.
    """
    model = config.model
    complaints: list[str] = []
    for kind in model.trained:
        section = getattr(model, kind)
        size = section.fit.batch_size
        # the statistics of one sample at one position are no statistics
        normalised = getattr(section, "norm", None) == "batch"
        least = 2 if normalised and processes > 1 else 1
        if size % processes or size < least * processes:
            complaints.append(
                f"model.{kind}.fit.batch_size is {size}, but {processes} processes share every "
                f"batch: choose a multiple of {processes}, {least * processes} or more"
            )
    if complaints:
        raise UserError("; ".join(complaints) + ".")
