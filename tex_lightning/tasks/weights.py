"""Which pretrained weights a model starts from, where a sweep gives some for several trunks."""

from dataclasses import replace
from typing import cast

from omegaconf import DictConfig, OmegaConf

from tex_lightning.errors import UserError
from tex_lightning.networks.trunks import TRUNKS
from tex_lightning.schema import Config


def read_config(composed: DictConfig) -> Config:
    """A composed configuration as a typed one, with the weights of its own model."""
    return pick_weights(cast(Config, OmegaConf.to_object(composed)))


def pick_weights(config: Config) -> Config:
    """Replace ``weights={TRUNK: SOURCE, …}`` by the source for this model's trunk, or by null.

    Raises:
        UserError: If ``weights`` is neither a source nor such a mapping.
    """
    given = config.weights
    if given is None or isinstance(given, str):
        return config
    if not isinstance(given, dict) or not set(given) <= set(TRUNKS):
        raise UserError(
            f"weights={given} is not understood; give one file, address or `imagenet`, or one for "
            f"each trunk as {{TRUNK: FILE}} with trunks of {', '.join(TRUNKS)}."
        )
    model = config.model
    if model.baseline is not None:
        return replace(config, weights=given.get(model.settings.get("trunk")))
    return replace(
        config, weights=None if model.kind == "haptic" else given.get(model.visual.trunk)
    )
