"""Training of HapticNet on sub-samples of spectrograms."""

from collections.abc import Iterator
from typing import cast

from torch import Tensor, nn

from tex_lightning.data.datamodule import Batch
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.networks.hapticnet import HapticNet


class HapticModule(SurfaceModule):
    """HapticNet: every position of a sub-sample is a fragment with the sample's label."""

    def inputs(self, batch: Batch) -> tuple[Tensor, ...]:
        """Normalised spectrograms (batch, 1, 50, frames)."""
        return (batch["spectrogram"],)

    @property
    def network(self) -> HapticNet:
        """The network, by its own type."""
        return cast(HapticNet, self.classifier.network)

    def backbone_parameters(self) -> Iterator[nn.Parameter]:
        """The 3x3 and 4x12 convolutions."""
        yield from self.network.trunk.parameters()

    def head_parameters(self) -> Iterator[nn.Parameter]:
        """The 1x1 convolutions."""
        yield from self.network.head.parameters()
