"""From a composed configuration to the typed and checked one.

Types, ranges and choices of single keys stand in the annotations of sections and classes; keys that
need each other are in :mod:`.rules`. All complaints are made at once, before any work. What else a
class rejects it says itself when it is made.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from omegaconf import MISSING, DictConfig, OmegaConf
from omegaconf.errors import ConfigKeyError, OmegaConfBaseException

from tex_lightning.config import READ_FILES, Config, flatten, trunk_name
from tex_lightning.config.instantiation import find_class
from tex_lightning.config.keys import choice
from tex_lightning.config.mistakes import refusal, unknown_key
from tex_lightning.config.model import (
    CHECKPOINT,
    ModelConfig,
    PhotoConfig,
    SenseConfig,
    SignalConfig,
)
from tex_lightning.config.nodes import as_taken, is_node, node_complaints, shared_complaints, takes
from tex_lightning.config.rules import RULES, unread_where_set
from tex_lightning.config.signatures import TARGET, misfits
from tex_lightning.errors import UserError, nearest

Sets = Callable[[str], bool]
SCHEMAS = {"signal": SignalConfig, "photo": PhotoConfig}  # by the medium of a sense


def checked_config(composed: DictConfig, sets: Sets = lambda _: False) -> Config:
    """Return the typed form of a composed configuration, checked.

    The arguments are those of :func:`check_config`.

    Raises:
        UserError: If a key or value cannot be used.
    """
    config = read_config(composed)
    check_config(config, sets)
    return config


def read_config(composed: DictConfig) -> Config:
    """Return the typed form of a composed configuration, with custom senses.

    Raises:
        UserError: If a key is open (``???``) or read by nothing, or a sense cannot be used.
    """
    if missing := missing_keys(composed):
        example = " ".join(f"{key}=VALUE" for key in missing)
        raise UserError(f"No value for {', '.join(missing)}; add {example} to the command.")
    if shadow := next(_shadows(composed), None):
        raise unknown_key(shadow, composed)
    config: Config = OmegaConf.to_object(composed)  # type: ignore[assignment]
    if not isinstance(config, Config):  # of a file that --config-name gives in its place
        raise UserError(
            "The configuration file of --config-name does not begin with that of the package: put "
            "defaults: [config, _self_] in front."
        )
    model = config.model
    for name, node in vars(model).items():
        is_sense = isinstance(node, dict) and (TARGET in node or name in model.senses)
        if is_sense and name != "baseline":
            setattr(model, name, _custom_sense(name, node, composed))
    for section in map(model.sense, model.known):
        vars(section).update(as_taken(section.node))
    for name in _further_keys(config):
        if "." not in name and config.task in READ_FILES:  # where a key names files of a sense
            config.own[name] = getattr(config, name)
        elif not (name.startswith("model.") and _is_referred_to(name, composed)):
            raise unknown_key(name, composed)
    for name in map(str, model.senses):  # a user can give anything in its place
        if name not in model.known:
            raise _unknown_sense(name, model)
    return config


def _unknown_sense(name: str, model: ModelConfig) -> UserError:
    """Return the error for a sense that is nowhere described."""
    by_modality = {model.sense(each).modality: each for each in reversed(model.known)}
    near = nearest(by_modality.get(name, name), model.known)  # image is that of visual
    return UserError(
        f"model.senses names {name}{near}, and there is no such sense: choose from "
        f"{', '.join(model.known)}, or write conf/sense/{name}.yaml and give --config-dir conf."
    )


def missing_keys(composed: DictConfig) -> list[str]:
    """Return dotted names of open ``???`` values, without interpolations that refer to them."""
    values: Any = OmegaConf.to_container(composed, resolve=False)
    return sorted(key for key, value in flatten(values).items() if value == MISSING)


def _shadows(node: DictConfig, prefix: str = "") -> Iterator[str]:
    """Yield the keys that would take the place of methods and properties of their section."""
    kind: Any = OmegaConf.get_type(node)
    known = [key.name for key in fields(kind)] if is_dataclass(kind) else []
    for name in map(str, node):
        if known and name not in known and hasattr(kind, name):
            yield f"{prefix}{name}"
        if isinstance(child := node._get_node(name), DictConfig) and not child._is_none():
            yield from _shadows(child, f"{prefix}{name}.")


def _further_keys(section: Any, prefix: str = "") -> Iterator[str]:  # noqa: ANN401
    """Yield the keys beside the schema's that neither Lightning nor a class of a sense reads."""
    known = {key.name for key in fields(section)}
    for name, value in vars(section).items():
        if is_dataclass(value):
            yield from () if name == "trainer" else _further_keys(value, f"{prefix}{name}.")
        elif isinstance(section, SenseConfig) and takes(section.node, name, *section.classes):
            continue
        elif name not in known and not (prefix == "model.fusion." and name.endswith(CHECKPOINT)):
            yield f"{prefix}{name}"


def _is_referred_to(name: str, composed: DictConfig) -> bool:
    """Return whether a value is an interpolation of a key, as of one that two classes share."""
    values: Any = OmegaConf.to_container(composed, resolve=False)
    pattern = re.compile(rf"\$\{{[^}}]*\b{re.escape(name.rpartition('.')[2])}\b")
    return any(isinstance(x, str) and pattern.search(x) for x in flatten(values).values())


def _custom_sense(name: str, node: dict[str, Any], composed: DictConfig) -> SenseConfig:
    where = f"model.{name}"
    medium = getattr(find_class(where, node), "medium", None) if TARGET in node else None
    if medium not in SCHEMAS:
        raise UserError(
            f"{where} names {node.get(TARGET, 'no class')}, which is no sense: begin its file with "
            "defaults: [signal, _self_] or [photo, _self_]."
        )
    schema = OmegaConf.structured(SCHEMAS[medium])
    for section in (schema, schema.fit.optimizer, schema.fit.schedule):
        OmegaConf.set_struct(section, False)  # further keys are offered to its classes
    try:
        merged = OmegaConf.merge(schema, node)
        steps = composed.model.budget * merged.fit.steps_per_epoch
        merged.fit.steps_per_epoch = max(1, round(steps))
        sense: SenseConfig = OmegaConf.to_object(merged)  # type: ignore[assignment]
    except ConfigKeyError as error:
        raise unknown_key(f"{where}.{error.full_key}", composed) from error
    except OmegaConfBaseException as error:
        raise UserError(
            f"{where}.{error.full_key}".rstrip(".")
            + f" cannot be used: {refusal(str(error).splitlines()[0])}; "
            f"correct it in the command or in conf/sense/{name}.yaml."
        ) from error
    return sense


def check_config(config: Config, sets: Sets = lambda _: False) -> None:
    """Reject invalid values, naming all of them in one sentence.

    Args:
        config: The typed configuration.
        sets: Whether the command sets a key (:meth:`.Job.sets`), which its task then has to read.

    Raises:
        UserError: If there are any.
    """
    broken = [complaint for rule in RULES for wrong, complaint in rule(config) if wrong]
    broken += unread_where_set(config, sets)
    complaints = [*broken, *_values(config), *_parts(config), *_unknown_names(config)]
    if complaints:
        raise UserError("; ".join(dict.fromkeys(complaints)) + ".")


def _values(section: Any, prefix: str = "") -> Iterator[str]:  # noqa: ANN401
    """Yield a complaint for each value of the sections that their fields do not take."""
    values = vars(section)  # senses of a user beside the fields
    yield from misfits(prefix, type(section), values)
    for name, value in values.items():
        if is_dataclass(value):
            yield from _values(value, f"{prefix}.{name}".removeprefix("."))


def _parts(config: Config) -> Iterator[str]:
    """Yield a complaint for each value that a class which the configuration names does not take."""
    model, data = config.model, config.data
    told = [key for key, x in vars(data).items() if any(misfits("data", type(data), {key: x}))]
    yield from node_complaints("data.reader", data.reader)
    yield from node_complaints("model.baseline", model.baseline)
    for name in model.known:
        section, where = model.sense(name), f"model.{name}"
        yield from shared_complaints(where, section.node, *section.classes)
        if name in model.senses:
            for part in ("features", "network"):
                if not is_node(section.node[part]):
                    yield f"{where}.{part} names no class: give {{_target_: MODULE.CLASS}}"
            decode = section.decode.items()
            given = {key: x for key, x in decode if x is not None and key not in told}
            yield from node_complaints(f"{where}.decode", {TARGET: section.decoder, **given})
            for part, node in section.node.items():
                yield from node_complaints(f"{where}.{part}", node)


def _unknown_names(config: Config) -> Iterator[str]:
    """Yield a sentence for each name that no sense and no perturbation has."""
    model, senses = config.model, config.frontier.senses
    checkpoints = [f"{name}{CHECKPOINT}" for name in model.known]
    if isinstance(config.weights, dict):
        from tex_lightning.networks.trunks import TRUNKS  # takes PyTorch

        trunks = [*TRUNKS, trunk_name(model, "visual"), *(set(model.known) - {"visual"})]
        for name in config.weights:
            yield from choice("a trunk in weights", name, trunks)
    for key in vars(model.fusion):
        if key.endswith(CHECKPOINT):
            yield from choice("a key of model.fusion", key, checkpoints)
    for sense in senses or ():
        yield from choice("frontier.senses", sense, model.known)
    for name in model.known:
        node = model.sense(name)
        for perturbation in node.fit.perturb:
            # loads OpenCV, which predictions do without
            from tex_lightning.perturbations.table import trainable

            known = trainable(node.modality)
            yield from choice(f"model.{name}.fit.perturb", perturbation, known)
