"""Train FusionNet from trained unimodal networks (paper, section III-B).

It learns on pieces that give one prediction each, with a faster head.
"""

from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any, Self

import torch
from torch import Tensor, nn

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.networks.fusionnet import FusionLayer


class FusionModule(SurfaceModule):
    """Train FusionNet on tuples of fragments, one of each sense, all of one class.

    Arguments are those of :class:`SurfaceModule`; pieces are as small as a single fragment where
    the network says how small that is.
    """

    def __init__(self, card: Card, fit: dict[str, Any], seed: int, pieces: dict[str, int]) -> None:
        super().__init__(card, fit, seed, pieces)
        senses = self.classifier.senses.items()
        self.pieces = {name: sense.piece_size(pieces[name]) for name, sense in senses}

    @property
    def fusion(self) -> FusionLayer:
        """The fusion layer."""
        layer = self.classifier.fusion
        assert layer is not None  # a card of several senses has one
        return layer

    def parts(self, inputs: list[Tensor]) -> list[Tensor]:
        """Partial logits (batch, classes, positions) of all senses for their input tensors."""
        given = zip(self.classifier.senses.values(), self.fusion.levels, inputs, strict=True)
        features = [sense.score(x, level).flatten(2) for sense, level, x in given]
        return [self.fusion.project(index, each) for index, each in enumerate(features)]

    def scores_of(self, inputs: list[Tensor]) -> Tensor:
        """Class scores (batch, classes, tuples); for a share of the samples of one sense alone.

        What one sense says is trained to be right, and to be weak where it is not: a modality that
        is missing, or out of order, then leaves the decision to the others.
        """
        parts = self.parts(inputs)
        dropout: float = self.fit_config["modality_dropout"]
        if dropout > 0:
            draw = torch.rand(len(parts[0]), 1, 1, device=parts[0].device)
            alone = (draw * len(parts) / dropout).long()  # a sense, or beyond them all of them
            parts = [
                part * ((alone == index) | (alone >= len(parts)))
                for index, part in enumerate(parts)
            ]
        counts, tuples = [part.shape[-1] for part in parts], None
        if max(counts) > 1:  # of a network that gives several positions for a piece
            positions = torch.arange(max(counts), device=parts[0].device)
            tuples = torch.stack([positions % count for count in counts], dim=1)
        return self.fusion.fuse(parts, tuples)

    def backbone_parameters(self) -> Iterator[nn.Parameter]:
        """The networks of all senses."""
        senses = self.classifier.senses.values()
        yield from chain.from_iterable(sense.network.parameters() for sense in senses)

    def head_parameters(self) -> Iterator[nn.Parameter]:
        """The fusion layer."""
        yield from self.fusion.parameters()

    def train(self, mode: bool = True) -> Self:
        """Keep the statistics of batch normalisation that the unimodal networks learnt.

        They were gathered on dense outputs of larger inputs, as in testing.
        """
        super().train(mode)
        for module in self.classifier.modules():
            if isinstance(module, nn.BatchNorm2d):
                module.eval()
        return self


def start_fusion(
    module: FusionModule, starts: Mapping[str, SurfaceClassifier], head_start: str
) -> None:
    """Copy the weights of unimodal networks, and what their features have learnt.

    Args:
        module: Module of the fusion.
        starts: By sense the classifier whose weights are copied.
        head_start: ``scores`` begins with the sum of all networks' class scores, ``random`` with
            small random weights.
    """
    for name, start in starts.items():
        sense, source = module.classifier.senses[name], start.cpu().senses[name]
        sense.features.load_state_dict(source.features.state_dict())
        own = sense.network.state_dict()  # without FC3 where FC2 is fused
        weights = source.network.state_dict()
        sense.network.load_state_dict({key: weights[key] for key in own})
        sense.network.eval()  # and stays so: networks that are trained already need no dropout
    if head_start == "scores":
        module.fusion.start_from_scores(*(start.network for start in starts.values()))
