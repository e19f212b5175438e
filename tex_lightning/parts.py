"""A FusionNet taken apart: a classifier for each modality, for when the other is absent."""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from typing import cast

import torch
from torch import Tensor

from tex_lightning.card import Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.data.folds import NEEDS, Kind
from tex_lightning.data.recordings import Modality
from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.visualnet import VisualNet

UNIMODAL: tuple[Kind, ...] = ("haptic", "visual")


def unimodal_parts(classifier: SurfaceClassifier) -> Iterator[SurfaceClassifier]:
    """A classifier itself, or the two that a fusion consists of.

    Where FC2 is fused there is no FC3 of their own; each takes its half of the fusion layer, so
    that their scores add up to those of the fusion.
    """
    if not isinstance(classifier.network, FusionNet):
        yield classifier
        return
    for kind in UNIMODAL:
        yield _part(classifier, kind)


@torch.no_grad()
def _part(classifier: SurfaceClassifier, kind: Kind) -> SurfaceClassifier:
    """A copy of one half, as trained or as the engine has rewritten it."""
    fusion = cast(FusionNet, classifier.network)
    part = SurfaceClassifier(part_card(classifier.card, kind))
    if kind == "haptic":
        part.haptic_features = deepcopy(classifier.haptic_features)
    network = deepcopy(fusion.haptic if kind == "haptic" else fusion.visual)
    if fusion.level == "fc2":
        own = cast(HapticNet | VisualNet, part.network).head
        halves = fusion.head.weight.tensor_split([fusion.haptic_size], dim=1)
        own.score_layer.weight.copy_(halves[UNIMODAL.index(kind)][:, :, None, None])
        bias = cast(Tensor, own.score_layer.bias)  # of the fusion: `project_visual` adds it
        bias.copy_(fusion.head.bias if kind == "visual" else torch.zeros_like(bias))
        network.head.scores = own.scores
    part.network = network
    return part


def part_card(fusion: Card, kind: Kind) -> Card:
    """The card of one half of a fusion."""
    if kind == "haptic":
        return replace(fusion, kind=kind, visual_network={}, fusion={}, calibration={})
    return replace(
        fusion, kind=kind, haptic_features={}, haptic_network={}, fusion={}, calibration={}
    )


def part_for(classifier: SurfaceClassifier, modality: Modality) -> SurfaceClassifier:
    """What of a FusionNet classifies recordings of ``modality`` when the other is absent.

    At level FC2 that is half of the fusion layer on one network: pairs would add the same score of
    the absent modality to all, and do not exist. At FC3 it is the network with its own scores.
    """
    kind = next(kind for kind in UNIMODAL if NEEDS[kind] == (modality,))
    return _part(classifier, kind).to(classifier.device).eval()
