"""Which pretrained weights a model starts from, where a sweep gives some for several trunks."""

from dataclasses import replace
from typing import Any, cast

from omegaconf import DictConfig, OmegaConf

from tex_lightning.config import Config
from tex_lightning.config.instantiation import TARGET
from tex_lightning.errors import UserError
from tex_lightning.networks.trunks import TRUNKS, name_trunk

HAPTIC = "haptic"  # HapticNet has one trunk, which goes by this name


def read_config(composed: DictConfig) -> Config:
    """A composed configuration as a typed one, with the weights of its own model."""
    return pick_weights(cast(Config, OmegaConf.to_object(composed)))


def pick_weights(config: Config) -> Config:
    """Keep of ``weights={TRUNK: SOURCE, haptic: SOURCE, …}`` what this model has a trunk for.

    What is kept is one source, for FusionNet perhaps one for each part, or null.

    Raises:
        UserError: If ``weights`` is neither a source nor such a mapping.
    """
    given = config.weights
    if given is None or isinstance(given, str):
        return config
    own = _trunk_name(config.model.visual.trunk)
    if not isinstance(given, dict) or not set(given) <= {HAPTIC, own, *TRUNKS}:
        raise UserError(
            f"weights={given} is not understood; give one file, address or `imagenet`, or one for "
            f"each trunk as {{TRUNK: FILE}} with trunks of {HAPTIC}, {', '.join(TRUNKS)}."
        )
    model = config.model
    if model.baseline is not None:
        return replace(config, weights=given.get(model.baseline.get("trunk")))
    if model.kind == "haptic":
        return replace(config, weights=given.get(HAPTIC))
    visual, haptic = given.get(own), given.get(HAPTIC)
    if model.kind == "visual" or haptic is None:
        return replace(config, weights=visual)
    return replace(config, weights={"haptic": haptic, "visual": visual})


def _trunk_name(node: dict[str, Any]) -> str:
    """What the trunk goes by in ``weights``: its published name, or that of its class."""
    module, _, name = str(node.get(TARGET)).rpartition(".")
    known = (cls for cls in TRUNKS.values() if (cls.__module__, cls.__name__) == (module, name))
    return next(map(name_trunk, known), name)
