"""Turn a composed configuration into typed objects, with the user's own senses and weights."""

from dataclasses import fields, replace
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from tex_lightning.config import Config
from tex_lightning.config.instantiation import TARGET, find_class
from tex_lightning.config.model import PhotoFitConfig, SenseConfig, SignalFitConfig
from tex_lightning.errors import UserError, reason
from tex_lightning.networks.trunks import TRUNKS, name_trunk

FITS = {"signal": SignalFitConfig, "photo": PhotoFitConfig}  # by the medium of a sense


def read_config(composed: DictConfig) -> Config:
    """A composed configuration as a typed one, with the weights of its own model.

    Raises:
        UserError: If a sense or the weights cannot be used.
    """
    config: Any = OmegaConf.to_object(composed)
    keys = {key.name for key in fields(Config)}
    config.own |= {name: value for name, value in vars(config).items() if name not in keys}
    model = config.model
    for name, node in list(vars(model).items()):
        if isinstance(node, dict) and TARGET in node and name != "baseline":
            setattr(model, name, _custom_sense(name, node, model.budget))
    for name in model.senses:
        if name not in model.known:
            raise UserError(
                f"model.senses names {name}, and there is no such sense: choose from "
                f"{', '.join(model.known)}, or write conf/sense/{name}.yaml and give "
                "--config-dir conf."
            )
    return pick_weights(config)


def _custom_sense(name: str, node: dict[str, Any], budget: float) -> SenseConfig:
    where = f"model.{name}"
    medium = getattr(find_class(where, node), "medium", None)
    if medium not in FITS:
        raise UserError(
            f"{where} names {node[TARGET]}, which is no sense: begin its file with defaults: "
            "[signal, _self_] or [photo, _self_]."
        )
    schema, fit = OmegaConf.structured(SenseConfig), OmegaConf.structured(FITS[medium])
    for section in (schema, fit.optimizer, fit.schedule):
        OmegaConf.set_struct(section, False)  # further keys are offered to its classes
    schema.fit = fit
    try:
        merged = OmegaConf.merge(schema, node)
        merged.fit.steps_per_epoch = max(1, round(budget * merged.fit.steps_per_epoch))
        sense: SenseConfig = OmegaConf.to_object(merged)  # type: ignore[assignment]
    except OmegaConfBaseException as error:
        raise UserError(
            f"{where}: {reason(str(error).splitlines()[0])}; correct conf/sense/{name}.yaml."
        ) from error
    return sense


def pick_weights(config: Config) -> Config:
    """Keep of ``weights={TRUNK: SOURCE, haptic: SOURCE, …}`` what this model has a trunk for.

    What is kept is one source, for FusionNet perhaps one for each sense, or null.

    Raises:
        UserError: If ``weights`` is neither a source nor such a mapping.
    """
    sources, model = config.weights, config.model
    if sources is None or isinstance(sources, str):
        return config
    trunk = _trunk_name(model.visual.trunk)
    known = [*(name for name in model.known if name != "visual"), *TRUNKS]
    if not isinstance(sources, dict) or not set(sources) <= {trunk, *known}:
        raise UserError(
            f"weights={sources} is not understood; give one file, address or `imagenet`, or one "
            f"for each trunk as {{TRUNK: FILE}} with trunks of {', '.join(known)}."
        )
    if model.baseline is not None:
        return replace(config, weights=sources.get(model.baseline.get("trunk")))
    named = {name: sources.get(trunk if name == "visual" else name) for name in model.senses}
    kept = {name: source for name, source in named.items() if source is not None}
    if len(model.senses) == 1 or set(kept) <= {"visual"}:
        return replace(config, weights=next(iter(kept.values()), None))
    return replace(config, weights=kept)


def _trunk_name(node: dict[str, Any]) -> str:
    """What the trunk goes by in ``weights``: its published name, or that of its class."""
    module, _, name = str(node.get(TARGET)).rpartition(".")
    known = (cls for cls in TRUNKS.values() if (cls.__module__, cls.__name__) == (module, name))
    return next(map(name_trunk, known), name)
