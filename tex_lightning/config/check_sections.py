"""Checks of ``data``, ``model`` and the Trainer's flags beyond single keys."""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from tex_lightning.config import DataConfig, ModelConfig, TrainerConfig
from tex_lightning.config.annotations import annotations, fits, in_words, parameters
from tex_lightning.config.check_ranges import choice, least, nearest
from tex_lightning.config.check_senses import check_senses
from tex_lightning.config.fit import SignalFitConfig
from tex_lightning.config.instantiation import find_class
from tex_lightning.errors import shorten
from tex_lightning.perturbations.table import trainable

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
