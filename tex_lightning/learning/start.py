"""Start a trunk from given weights: ImageNet's, or those of a checkpoint of this package."""

import inspect
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch

from tex_lightning.classifier.card import SUFFIX, Card, read_checkpoint
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.config.model import FUSION
from tex_lightning.core.console import log_once
from tex_lightning.core.contract import calling
from tex_lightning.core.devices import pick_device
from tex_lightning.data.banks import Bank, Indices, InputBank, PhotoBank
from tex_lightning.data.datamodule import TrainingBatches
from tex_lightning.errors import UserError
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.learning.visual_head import fit_linear_head
from tex_lightning.networks.linear import LinearNet
from tex_lightning.networks.trunks import Trunk
from tex_lightning.networks.visualnet import VisualNet
from tex_lightning.networks.weights import load_trunk_weights, warn_of_random_weights

log = logging.getLogger(__name__)

# keys of a branch that its trunk can do without
HEADS = ("decode", "network", "dropout", "skip_impact", "fc1_kernel", "head")


def start_trunk(classifier: SurfaceClassifier, source: str) -> str:
    """Load weights into the trunk of HapticNet or VisualNet; its head stays as it is.

    Args:
        classifier: Classifier of a haptic or visual network.
        source: A checkpoint (.ckpt) of the same kind, of which the trunk is taken and nothing
            else; for VisualNet also what
            :func:`~tex_lightning.networks.weights.load_trunk_weights` takes.

    Returns:
        One line saying what was loaded.

    Raises:
        UserError: If the source cannot be used, or its trunk is another.
    """
    sense, network = classifier.card.kind, classifier.network
    trunk: Any = getattr(network, "trunk", None)
    if trunk is None:
        raise UserError(f"weights: {type(network).__name__} has no trunk to fill; leave it null.")
    start = starting_classifier(source, classifier.card)
    if start is not None:
        trunk.load_state_dict(start.network.get_submodule("trunk").state_dict())
        return f"Trunk from {name_source(source)}."
    if not isinstance(trunk, Trunk):
        raise UserError(
            f"weights: {type(network).__name__} starts from a checkpoint, and {source} does "
            f"not end in {SUFFIX}; give that of a run with model.senses=[{sense}]."
        )
    return load_trunk_weights(trunk, source)


def starting_classifier(source: str, card: Card) -> SurfaceClassifier | None:
    """Return the classifier in a checkpoint whose trunk can become that of ``card``.

    Args:
        source: As for :func:`start_trunk`.
        card: Card of the classifier that is to start from it.

    Returns:
        None where ``source`` is no checkpoint of this package but a file with ImageNet's weights.

    Raises:
        UserError: If it is a checkpoint and cannot be used.
    """
    path = Path(source)
    if path.suffix != SUFFIX:
        return None
    start = SurfaceClassifier.from_checkpoint(path, card.kind)
    ours, theirs = _shape(card), _shape(start.card)
    other = {key: value for key, value in theirs.items() if ours.get(key) != value}
    if other:
        said = " ".join(f"model.{card.kind}.{key}={value}" for key, value in other.items())
        raise UserError(f"weights: the trunk in {source} is another; set {said} as it was trained.")
    return start


def _shape(card: Card) -> dict[str, Any]:
    """Return the settings that the trunk's weights depend on."""
    node = card.senses[card.kind]
    rate = {"decode.sampling_rate": node["decode"].get("sampling_rate")}
    return {**rate, **{key: value for key, value in node.items() if key not in HEADS}}


def name_source(source: str) -> str:
    """Name a source of weights, and for a checkpoint of this package also its training data."""
    if Path(source).suffix != SUFFIX:
        return source
    stored = read_checkpoint(source)["hyper_parameters"]["card"]
    return f"{source} (trained on {len(stored['trained_on']['seen'])} recordings)"


def start_network(
    config: Config, module: SurfaceModule, batches: TrainingBatches, groups: Sequence[str]
) -> None:
    """Fill the trunk with the given weights, and fit what is fitted to all recordings at once.

    That is VisualNet's head on pretrained features, and a network of signals that has a method
    ``fit(inputs, labels)`` or ``fit(inputs, labels, groups)``, as
    :class:`~tex_lightning.networks.linear.LinearNet`.

    Args:
        config: Names the weights to start from.
        module: Module of the network, on the CPU, where it is left.
        batches: Of which a head learns.
        groups: Group of each training recording of the first sense.

    Raises:
        UserError: If the weights cannot be used.
    """
    weights = config.start_of(module.kind)
    if weights is not None:
        log_once(log, start_trunk(module.classifier, weights))
    if module.kind == FUSION:
        return
    network, (bank, labels) = module.network, batches.banks[module.kind]
    if hasattr(network, "fit"):
        with calling(f"model.{module.kind}.network", "network", network):
            fit_closed_form(network, bank, labels, groups)
    if isinstance(network, VisualNet) and not network.has_hidden_layers:
        if weights is None:
            warn_of_random_weights(network.trunk)
        module.to(pick_device(config.trainer.accelerator))
        fit_linear_head(module, cast(PhotoBank, bank), labels, groups)
        module.to("cpu")


def fits_probabilities(classifier: SurfaceClassifier) -> bool:
    """Return whether what was fitted at once gives probabilities, by groups that it left out."""
    if classifier.fusion is not None:
        return False
    network = classifier.network
    linear = isinstance(network, VisualNet) and not network.has_hidden_layers
    return linear or isinstance(network, LinearNet)


def fit_closed_form(network: Any, bank: Bank, labels: Indices, groups: Sequence[str]) -> None:  # noqa: ANN401
    """Fit a network that has a method ``fit`` to all recordings and their perturbed copies."""
    inputs = cast(InputBank, bank).inputs
    given: list[Any] = [inputs, torch.from_numpy(np.resize(labels, len(inputs)))]
    if "groups" in inspect.signature(network.fit).parameters:
        given.append([*groups] * (len(inputs) // len(labels)))
    network.fit(*given)
