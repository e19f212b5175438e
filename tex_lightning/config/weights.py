"""Turn a composed configuration into typed objects, with the user's own senses and weights."""

from dataclasses import fields, replace
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from tex_lightning.config import Config
from tex_lightning.config.instantiation import TARGET, find_class
from tex_lightning.config.model import CustomPhotoConfig, CustomSignalConfig
from tex_lightning.errors import UserError
from tex_lightning.networks.trunks import TRUNKS, name_trunk

OWN = {"signal": CustomSignalConfig, "photo": CustomPhotoConfig}  # by the medium of a branch


def read_config(composed: DictConfig) -> Config:
    """A composed configuration as a typed one, with the weights of its own model.

    Raises:
        UserError: If a sense or the weights cannot be used.
    """
    config: Any = OmegaConf.to_object(composed)
    known = {each.name for each in fields(Config)}
    config.own |= {name: value for name, value in vars(config).items() if name not in known}
    model = config.model
    own = vars(model).keys() - {each.name for each in fields(model)}
    for name, node in list(vars(model).items()):
        if name in own and isinstance(node, dict) and TARGET in node:
            setattr(model, name, _own_sense(name, node, model.budget))
    for name in model.senses:
        if name not in model.known:
            raise UserError(
                f"model.senses names {name}, and there is no such sense: choose from "
                f"{', '.join(model.known)}, or write conf/sense/{name}.yaml and give "
                "--config-dir conf."
            )
    return pick_weights(config)


def _own_sense(name: str, node: dict[str, Any], budget: float) -> object:
    where = f"model.{name}"
    medium = getattr(find_class(where, node), "medium", None)
    if medium not in OWN:
        raise UserError(
            f"{where} names {node[TARGET]}, which is no sense: begin its file with defaults: "
            "[signal, _self_] or [photo, _self_]."
        )
    schema = OmegaConf.structured(OWN[medium])
    for opened in (schema, schema.fit.optimizer, schema.fit.schedule):
        OmegaConf.set_struct(opened, False)  # further keys are offered to its classes
    try:
        merged = OmegaConf.merge(schema, node)
        merged.fit.steps_per_epoch = max(1, round(budget * merged.fit.steps_per_epoch))
        return OmegaConf.to_object(merged)
    except OmegaConfBaseException as error:
        said = str(error).splitlines()[0].rstrip(".")
        raise UserError(f"{where}: {said}; correct conf/sense/{name}.yaml.") from error


def pick_weights(config: Config) -> Config:
    """Keep of ``weights={TRUNK: SOURCE, haptic: SOURCE, …}`` what this model has a trunk for.

    What is kept is one source, for FusionNet perhaps one for each sense, or null.

    Raises:
        UserError: If ``weights`` is neither a source nor such a mapping.
    """
    given, model = config.weights, config.model
    if given is None or isinstance(given, str):
        return config
    own = _trunk_name(model.visual.trunk)
    senses = [name for name in model.known if name != "visual"]
    if not isinstance(given, dict) or not set(given) <= {*senses, own, *TRUNKS}:
        raise UserError(
            f"weights={given} is not understood; give one file, address or `imagenet`, or one for "
            f"each trunk as {{TRUNK: FILE}} with trunks of {', '.join([*senses, *TRUNKS])}."
        )
    if model.baseline is not None:
        return replace(config, weights=given.get(model.baseline.get("trunk")))
    named = {name: given.get(own if name == "visual" else name) for name in model.senses}
    kept = {name: source for name, source in named.items() if source is not None}
    if len(model.senses) == 1 or set(kept) <= {"visual"}:
        return replace(config, weights=next(iter(kept.values()), None))
    return replace(config, weights=kept)


def _trunk_name(node: dict[str, Any]) -> str:
    """What the trunk goes by in ``weights``: its published name, or that of its class."""
    module, _, name = str(node.get(TARGET)).rpartition(".")
    known = (cls for cls in TRUNKS.values() if (cls.__module__, cls.__name__) == (module, name))
    return next(map(name_trunk, known), name)
