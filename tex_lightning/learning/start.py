"""Give a network its first weights: from files, from trained senses, or in closed form."""

import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import torch
from torch import nn

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, DataConfig, EngineConfig
from tex_lightning.config.model import FUSION
from tex_lightning.core.console import log_once
from tex_lightning.core.contract import calling
from tex_lightning.core.run_folder import SUFFIX
from tex_lightning.data.banks import Indices, PhotoBank
from tex_lightning.data.datamodule import TrainingBatches
from tex_lightning.data.recordings import Recordings
from tex_lightning.errors import UserError, listed
from tex_lightning.learning.linear_head import fit_linear_head, scores_textures
from tex_lightning.learning.module import SurfaceModule
from tex_lightning.learning.provenance import refuse_leak
from tex_lightning.networks.trunks import Trunk
from tex_lightning.networks.weights import load_trunk_weights, warn_of_random_weights
from tex_lightning.senses.signal import fit_closed_form

log = logging.getLogger(__name__)


def load_trunk(config: Config, card: Card, test: Recordings) -> SurfaceClassifier | None:
    """Load the checkpoint whose trunk a network starts from; None of weights from elsewhere.

    Raises:
        UserError: If it holds another kind of network, or was trained on test recordings.
    """
    source = None if card.baseline else config.sources.get(card.kind)
    network = None if source is None else _checkpoint(source, card.kind)
    if network is not None:
        seen = test.of(card.modalities[0])
        refuse_leak(seen, network.card, f"weights: checkpoint {source}", config.data)
    return network


def _checkpoint(source: str, kind: str) -> SurfaceClassifier | None:
    path = Path(source)
    return SurfaceClassifier.from_checkpoint(path, kind) if path.suffix == SUFFIX else None


def start_trunk(
    classifier: SurfaceClassifier, source: str, pretrained: SurfaceClassifier | None = None
) -> str:
    """Load weights into the trunk of a network, and return a sentence that says what was loaded.

    The head keeps its weights. The source is a checkpoint (.ckpt) of the same kind of network,
    loaded before (:func:`load_trunk`) or here; for VisualNet also one of
    :func:`~tex_lightning.networks.weights.load_trunk_weights`.

    Raises:
        UserError: If the source cannot be used, or its trunk has another shape.
    """
    sense, target = classifier.card.kind, classifier.network
    trunk: Any = getattr(target, "trunk", None)
    if not isinstance(trunk, nn.Module):
        raise UserError(f"weights: {type(target).__name__} has no trunk to fill; leave it null.")
    pretrained = pretrained or _checkpoint(source, sense)
    if pretrained is not None:
        try:
            trunk.load_state_dict(pretrained.network.get_submodule("trunk").state_dict())
        except RuntimeError as error:
            raise UserError(
                f"weights: the trunk in {source} is another; give model.{sense} the keys that it "
                "was trained with."
            ) from error
        return f"Trunk from {source}."
    if not isinstance(trunk, Trunk):
        raise UserError(
            f"weights: {type(target).__name__} starts from a checkpoint, and {source} does "
            f"not end in {SUFFIX}; give that of a run with model.senses=[{sense}]."
        )
    return load_trunk_weights(trunk, source)


def load_unimodal(path: Path, card: Card, test: Recordings, data: DataConfig) -> SurfaceClassifier:
    """Load a checkpoint of one sense, for FusionNet to start from.

    Raises:
        UserError: If it holds another kind of network or other classes, or was trained on test
            recordings.
    """
    network = SurfaceClassifier.from_checkpoint(path, card.kind)
    theirs = network.card
    if theirs.classes != card.classes:
        raise UserError(
            f"Checkpoint {path} knows {len(theirs.classes)} classes that are not the "
            f"{len(card.classes)} of this data; train it on the same data."
        )
    refuse_leak(test.of(theirs.modalities[0]), theirs, f"Checkpoint {path}", data)
    return network


def start_fusion(
    module: SurfaceModule, unimodal: Mapping[str, SurfaceClassifier], head_start: str
) -> None:
    """Copy networks and fitted features of trained senses into FusionNet.

    Args:
        module: Module of the fusion.
        unimodal: By sense the classifier whose weights are copied.
        head_start: First weights of the fusion layer: with ``scores`` it gives the sum of the
            class scores of all networks, with ``random`` its weights are small and random.
    """
    for name, network in unimodal.items():
        sense, source = module.classifier.senses[name], network.cpu().senses[name]
        sense.features.load_state_dict(source.features.state_dict())
        kept = sense.network.state_dict()  # without FC3 where FC2 is fused
        weights = source.network.state_dict()
        sense.network.load_state_dict({key: weights[key] for key in kept})
        sense.network.eval()  # and stays so: networks that are trained already need no dropout
    if head_start == "scores":
        module.fusion.start_from_scores(*(network.network for network in unimodal.values()))


def start_network(
    module: SurfaceModule,
    batches: TrainingBatches,
    groups: Sequence[str],
    weights: str | None,
    trunk: SurfaceClassifier | None,
    device: torch.device,
    engine: EngineConfig,
) -> None:
    """Load the weights of the trunk, and fit the layers that have a closed form.

    Such a layer is the head of a VisualNet without hidden layers. So is a whole network of signals
    that has a method ``fit``, as :class:`~tex_lightning.networks.linear.LinearNet`. Networks that
    neither applies to are left to the training steps.

    The module is on the CPU, and is left there; ``device`` and ``engine`` compute features.
    ``groups`` are those of the training recordings of the first sense, ``weights`` and ``trunk``
    the source of the trunk's weights or None, and its loaded checkpoint (:func:`start_trunk`).

    Raises:
        UserError: If the weights cannot be used.
    """
    if weights is not None:
        log_once(log, start_trunk(module.classifier, weights, trunk))
    if module.kind == FUSION:
        return
    network, (bank, labels) = module.network, batches.banks[module.kind]
    if hasattr(network, "fit") or scores_textures(network):
        _log_single_groups(labels, groups, module.classifier.card.classes)
    if hasattr(network, "fit"):
        with calling(f"model.{module.kind}.network", "network", network):
            fit_closed_form(network, bank, labels, groups)
    if scores_textures(network):
        if weights is None:
            warn_of_random_weights(network.trunk)
        module.to(device)
        fit_linear_head(module, cast(PhotoBank, bank), labels, groups, engine)
        module.to("cpu")


def _log_single_groups(labels: Indices, groups: Sequence[str], classes: Sequence[str]) -> None:
    """Log which classes have all recordings in one group, so that no group can be left out."""
    known = {*zip(labels.tolist(), groups, strict=True)}
    counts, grouped = Counter(labels.tolist()), Counter(label for label, _ in known)
    single = [classes[label] for label in counts if counts[label] > grouped[label] == 1]
    if single:
        log_once(
            log, f"All recordings of {listed(single)} are of one group. Settings and probabilities "
            "are fitted by leaving them out one by one, which is optimistic about new groups.",
        )  # fmt: skip
