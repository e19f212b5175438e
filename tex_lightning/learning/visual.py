"""Training of VisualNet on rotated patches."""

from collections.abc import Iterator
from typing import cast

from torch import Tensor, nn

from tex_lightning.data.datamodule import Batch
from tex_lightning.features.image import ImageFeatures
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.networks.visualnet import VisualNet


class VisualModule(SurfaceModule):
    """VisualNet: every position of a patch is a fragment with the photo's label."""

    def inputs(self, batch: Batch) -> tuple[Tensor, ...]:
        """Normalised, rotated patches (batch, 3, patch, patch)."""
        features = cast(ImageFeatures, self.classifier.image_features)
        patch = self.fit_config["patch"]
        return (features.rotated(batch["crop"], batch["degrees"], patch, batch["zoom"]),)

    @property
    def network(self) -> VisualNet:
        """The network, by its own type."""
        return cast(VisualNet, self.classifier.network)

    def backbone_parameters(self) -> Iterator[nn.Parameter]:
        """The convolutions of the trunk."""
        yield from self.network.trunk.parameters()

    def head_parameters(self) -> Iterator[nn.Parameter]:
        """FC1, FC2 and FC3."""
        yield from self.network.head.parameters()
