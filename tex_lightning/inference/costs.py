"""What a decision costs before it is made: multiply-accumulates by the size of the recordings."""

from functools import lru_cache
from typing import cast

import torch
from torch import Tensor

from tex_lightning.card import Card
from tex_lightning.classifier import build_network
from tex_lightning.inference.macs import count_macs
from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.networks.hapticnet import HapticNet


class Costs:
    """Multiply-accumulates of a card's network, counted on tensors that hold nothing.

    Convolutions and matrix products are counted; features, pooling and normalisation are not.

    Args:
        card: Of one of this package's networks.
    """

    def __init__(self, card: Card) -> None:
        with torch.device("meta"):
            self.network = build_network(card).eval()
        self.haptic = lru_cache(self._haptic)
        self.visual = lru_cache(self._visual)

    def _haptic(self, frames: int) -> int:
        """Of a spectrogram of so many frames, with the haptic part of a fusion layer."""
        network = self.network.haptic if isinstance(self.network, FusionNet) else self.network
        spectrogram = torch.empty(1, 1, HapticNet.bands, frames, device="meta")

        def run() -> Tensor:
            if not isinstance(self.network, FusionNet):
                return cast(Tensor, network(spectrogram))
            features = self.network.haptic.features(spectrogram, self.network.level)
            return self.network.project_haptic(features)

        return count_macs(run)

    def _visual(self, height: int, width: int) -> int:
        """Of a photo of so many pixels, with the visual part of a fusion layer."""
        network = self.network.visual if isinstance(self.network, FusionNet) else self.network
        pixels = torch.empty(1, 3, height, width, device="meta")

        def run() -> Tensor:
            if not isinstance(self.network, FusionNet):
                return cast(Tensor, network(pixels))
            features = self.network.visual.features(pixels, self.network.level)
            return self.network.project_visual(features.flatten(2))

        return count_macs(run)
