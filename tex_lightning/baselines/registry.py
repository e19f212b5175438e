"""Baselines by their name in ``conf/model``; a library is imported when one asks for it."""

import importlib
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from tex_lightning.errors import UserError, shorten

if TYPE_CHECKING:
    from tex_lightning.baselines.base import Baseline

BASELINES = {
    "fisher_vectors": "fisher:FisherVectors",
    "frozen_linear": "frozen:FrozenLinear",
    "local_binary_patterns": "patterns:LocalBinaryPatterns",
    "acnn": "acnn:RawNetwork",
    "mfcc_gmm": "mfcc_gmm:MfccMixtures",
    "mfcc_nb": "mfcc_nb:MfccNaiveBayes",
    "minirocket": "rocket:MiniRocket",
    "multirocket_hydra": "multirocket_hydra:MultiRocketHydra",
}
INSTALL = "pip install 'tex_lightning[baselines]'"


def make_baseline(name: str, settings: dict[str, Any], budget: float = 1.0) -> "Baseline":
    """A baseline that is not fitted yet.

    Args:
        name: A key of ``BASELINES``.
        settings: ``model.settings``.
        budget: ``model.budget``.

    Raises:
        UserError: If a library is missing, or a setting is unknown or of the wrong type.
    """
    if name not in BASELINES:
        raise UserError(f"model.baseline is {shorten(name)}: choose {', '.join(BASELINES)}.")
    try:
        cls = getattr(_module(name), BASELINES[name].partition(":")[2])
    except ModuleNotFoundError as error:
        raise UserError(
            f"model={name} needs {error.name}, which is not installed; run: {INSTALL}"
        ) from error
    try:
        typed = OmegaConf.merge(OmegaConf.structured(cls), settings)
        baseline = cast("Baseline", OmegaConf.to_object(typed))
    except OmegaConfBaseException as error:
        reason = str(error).splitlines()[0]
        raise UserError(f"model.settings of {name} cannot be used: {reason}.") from error
    return baseline.with_budget(budget) if budget != 1.0 else baseline


def missing_library(name: str) -> str | None:
    """The library that a baseline needs and that is not installed, or None."""
    try:
        _module(name)
    except ModuleNotFoundError as error:
        return error.name
    return None


def _module(name: str) -> ModuleType:
    return importlib.import_module(f"tex_lightning.baselines.{BASELINES[name].partition(':')[0]}")
