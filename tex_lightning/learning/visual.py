"""Training of VisualNet on rotated patches."""

from collections.abc import Iterator
from typing import Any, cast

from torch import Tensor, nn

from tex_lightning.config.instantiation import build, call
from tex_lightning.data.datamodule import Batch
from tex_lightning.features.image import ImageFeatures
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.networks.visualnet import VisualNet

AUGMENTATION = "model.visual.fit.augmentation"


class VisualModule(SurfaceModule):
    """VisualNet: every position of a patch is a fragment with the photo's label."""

    def __init__(self, card: dict[str, Any], fit: dict[str, Any], seed: int) -> None:
        super().__init__(card, fit, seed)
        node = fit.get("augmentation")
        self.augmentation = None if node is None else build(AUGMENTATION, node)

    def inputs(self, batch: Batch) -> tuple[Tensor, ...]:
        """Normalised, rotated and perhaps augmented patches (batch, 3, patch, patch)."""
        features = cast(ImageFeatures, self.classifier.image_features)
        patches = features.rotated(batch["crop"], batch["degrees"], self.fit_config["patch"])
        if self.augmentation is not None and self.training:
            pixels = call(AUGMENTATION, self.augmentation, patches * features.std + features.mean)
            patches = (pixels - features.mean) / features.std
        return (patches,)

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
