"""Training of FusionNet on inputs that give one prediction each (paper, section III-B)."""

from collections.abc import Iterator
from typing import Self, cast

import torch
from torch import Tensor, nn

from tex_lightning.data.datamodule import Batch
from tex_lightning.features.image import ImageFeatures
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.networks.fusionnet import FusionNet


class FusionModule(SurfaceModule):
    """FusionNet: one haptic and one visual fragment of the same class make a pair."""

    def inputs(self, batch: Batch) -> tuple[Tensor, ...]:
        """Spectrograms (batch, 1, 50, 192) and rotated patches (batch, 3, 224, 224)."""
        features = cast(ImageFeatures, self.classifier.image_features)
        patch = self.network.visual.patch
        return batch["spectrogram"], features.rotated(batch["crop"], batch["degrees"], patch)

    def scores(self, batch: Batch) -> Tensor:
        """As for the others, but for a share of the pairs either summand alone.

        What a trace or a photo says alone is trained to be right, and to be weak where it is not:
        a modality that is missing, or out of order, then leaves the decision to the other.
        """
        dropout: float = self.fit_config["modality_dropout"]
        if dropout == 0:
            return super().scores(batch)
        haptic, visual = self.network.parts(*self.inputs(batch))
        draw = torch.rand(len(haptic), 1, 1, device=haptic.device)
        haptic = haptic * (draw >= dropout / 2)
        return self.network.join(haptic, visual * (draw < 1 - dropout / 2))

    @property
    def network(self) -> FusionNet:
        """The network, by its own type."""
        return cast(FusionNet, self.classifier.network)

    def backbone_parameters(self) -> Iterator[nn.Parameter]:
        """Both unimodal networks."""
        yield from self.network.backbone_parameters()

    def head_parameters(self) -> Iterator[nn.Parameter]:
        """The fusion layer."""
        yield from self.network.head_parameters()

    def train(self, mode: bool = True) -> Self:
        """Keep the statistics of batch normalisation that the unimodal networks learnt.

        They were gathered on dense outputs of larger inputs, as in testing.
        """
        super().train(mode)
        for module in (*self.network.haptic.modules(), *self.network.visual.modules()):
            if isinstance(module, nn.BatchNorm2d):
                module.eval()
        return self
