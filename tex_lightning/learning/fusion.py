"""Train FusionNet from trained unimodal networks (paper, section III-B).

It learns on pieces that give one prediction each, with a faster head.
"""

import logging
from collections.abc import Iterator, Mapping
from typing import Any, Self

import torch
from lightning import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback
from torch import Tensor, nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config.model import MAX_FACTOR, MIN_FACTOR
from tex_lightning.data.datamodule import Batch
from tex_lightning.errors import UserError
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.networks.fusionnet import FusionNet


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


log = logging.getLogger(__name__)


class FusionStart(Callback):
    """Copy the unimodal networks and set the learning rate of the fusion layer.

    Args:
        starts: By sense the classifier whose network is copied.
        head_factor: Learning rate of the fusion layer over that of the networks, 10 to 50.
        head_start: ``scores`` begins with the sum of all networks' class scores, ``random`` with
            small random weights.

    Raises:
        UserError: If the factor is outside the paper's range.
    """

    def __init__(
        self,
        starts: Mapping[str, SurfaceClassifier],
        head_factor: float,
        head_start: str = "scores",
    ) -> None:
        if not MIN_FACTOR <= head_factor <= MAX_FACTOR:
            raise UserError(
                f"model.fusion.fit.head_factor is {head_factor:g}; "
                f"choose a value from {MIN_FACTOR:g} to {MAX_FACTOR:g}."
            )
        self.starts = starts
        self.head_factor = head_factor
        self.head_start = head_start

    def setup(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """Fill in weights and features; a resumed run overwrites them with its own later."""
        if stage != "fit" or not isinstance(pl_module, FusionModule):
            return
        target, head = pl_module.classifier, pl_module.network.head
        networks = []
        for name, start in self.starts.items():
            target.sense(name).adopt(start.cpu().sense(name))
            networks.append(start.network)
        fused = FusionNet(*networks, classes=len(target.card.classes), **target.card.fusion)
        if self.head_start == "scores":
            fused.start_from_scores(*networks)
        else:
            fused.head.load_state_dict(head.state_dict())  # drawn from the run's own seed
        target.network = fused
        pl_module.head_factor = self.head_factor

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """State the rates; each step's are logged as lr/backbone and lr/head."""
        groups = trainer.optimizers[0].param_groups  # no backbone where nothing in it is trained
        log.debug(
            "FusionNet starts from the networks of %s; learning rate of the %s.",
            " and ".join(self.starts),
            " and ".join(f"{group['name']} {group['lr']:.3g}" for group in groups),
        )
