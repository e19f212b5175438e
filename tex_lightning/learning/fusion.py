"""Training of FusionNet on pieces that give one prediction each (paper, section III-B)."""

from collections.abc import Iterator
from typing import Any, Self

import torch
from torch import Tensor, nn

from tex_lightning.data.datamodule import Batch
from tex_lightning.learning.base import SurfaceModule


class FusionModule(SurfaceModule):
    """Train FusionNet on tuples of fragments, one of each sense, all of one class.

    Arguments are those of :class:`SurfaceModule`; pieces are as small as a single fragment where
    the network says how small that is.
    """

    def __init__(
        self, card: dict[str, Any], fit: dict[str, Any], seed: int, pieces: dict[str, int]
    ) -> None:
        super().__init__(card, fit, seed, pieces)
        senses = self.classifier.senses.items()
        self.pieces = {name: sense.piece_size(pieces[name]) for name, sense in senses}

    def scores(self, batch: Batch) -> Tensor:
        """Class scores (batch, classes, tuples); for a share of the samples of one sense alone.

        What one sense says is trained to be right, and to be weak where it is not: a modality that
        is missing, or out of order, then leaves the decision to the others.
        """
        parts: list[Tensor] = self.network.parts(*self.inputs(batch))
        dropout: float = self.fit_config["modality_dropout"]
        if dropout > 0:
            draw = torch.rand(len(parts[0]), 1, 1, device=parts[0].device)
            alone = (draw * len(parts) / dropout).long()  # a sense, or beyond them all of them
            parts = [
                part * ((alone == place) | (alone >= len(parts)))
                for place, part in enumerate(parts)
            ]
        joined: Tensor = self.network.fuse(parts, _side_by_side(parts))
        return joined

    def backbone_parameters(self) -> Iterator[nn.Parameter]:
        """The networks of all senses."""
        yield from self.network.backbone_parameters()

    def head_parameters(self) -> Iterator[nn.Parameter]:
        """The fusion layer."""
        yield from self.network.head_parameters()

    def train(self, mode: bool = True) -> Self:
        """Keep the statistics of batch normalisation that the unimodal networks learnt.

        They were gathered on dense outputs of larger inputs, as in testing.
        """
        super().train(mode)
        for module in self.network.networks.modules():
            if isinstance(module, nn.BatchNorm2d):
                module.eval()
        return self


def _side_by_side(parts: list[Tensor]) -> Tensor | None:
    """Tuples of the positions of pieces, where a network gives several for one; else None."""
    counts = [part.shape[-1] for part in parts]
    if set(counts) == {1}:
        return None
    places = torch.arange(max(counts), device=parts[0].device)
    return torch.stack([places % count for count in counts], dim=1)
