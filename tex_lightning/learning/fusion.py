"""Training of FusionNet on inputs that give one prediction each (paper, section III-B)."""

from collections.abc import Iterator
from typing import Self, cast

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
        return batch["spectrogram"], features.rotated(
            batch["crop"], batch["degrees"], patch, batch["zoom"]
        )

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
