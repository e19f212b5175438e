"""A FusionNet taken apart: a classifier for each modality, for when the other is absent."""

from collections.abc import Iterator
from dataclasses import replace

import torch

from tex_lightning.classifier import Card, SurfaceClassifier
from tex_lightning.data.folds import NEEDS, Kind
from tex_lightning.data.recordings import Modality
from tex_lightning.networks.fusionnet import FusionNet

UNIMODAL: tuple[Kind, ...] = ("haptic", "visual")


def unimodal_parts(classifier: SurfaceClassifier) -> Iterator[SurfaceClassifier]:
    """A classifier itself, or the two that a fusion consists of.

    Where FC2 is fused there is no FC3 of their own; each takes its half of the fusion layer, so
    that their scores add up to those of the fusion.
    """
    fusion = classifier.network
    if not isinstance(fusion, FusionNet):
        yield classifier
        return
    halves = fusion.head.weight.tensor_split([fusion.haptic_size], dim=1)
    biases = (torch.zeros_like(fusion.head.bias), fusion.head.bias)
    for place, kind in enumerate(UNIMODAL):
        part = SurfaceClassifier(part_card(classifier.card, kind))
        part.adopt_haptic_features(classifier)
        state = (fusion.haptic, fusion.visual)[place].state_dict()
        if fusion.level == "fc2":
            state["head.scores.1.weight"] = halves[place][:, :, None, None]
            state["head.scores.1.bias"] = biases[place]
        part.network.load_state_dict(state)
        yield part


def part_card(fusion: Card, kind: Kind) -> Card:
    """The card of one half of a fusion."""
    if kind == "haptic":
        return replace(
            fusion, kind=kind, visual_network={}, image_features={}, fusion={}, calibration={}
        )
    return replace(
        fusion, kind=kind, haptic_features={}, haptic_network={}, fusion={}, calibration={}
    )


def part_for(classifier: SurfaceClassifier, modality: Modality) -> SurfaceClassifier:
    """What of a FusionNet classifies recordings of ``modality`` when the other is absent.

    At level FC2 that is half of the fusion layer on one network: pairs would add the same score of
    the absent modality to all, and do not exist. At FC3 it is the network with its own scores.
    """
    parts = {part.card.kind: part for part in unimodal_parts(classifier)}
    return next(part for kind, part in parts.items() if NEEDS[kind] == (modality,)).eval()
