"""What a profile is of, and how its dense pass runs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

from torch import Tensor

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.inference.tiles import in_tiles, layer_windows
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.visualnet import VisualNet

Network = HapticNet | VisualNet


@dataclass(frozen=True)
class Subject:
    """A unimodal classifier and what it is to classify.

    Attributes:
        classifier: In evaluation mode, as trained.
        recording: Decoded trace (axes, samples) or photo (height, width, 3).
    """

    classifier: SurfaceClassifier
    recording: Tensor

    @property
    def network(self) -> Network:
        """The network inside."""
        return network_of(self.classifier)

    def features(self, classifier: SurfaceClassifier) -> Tensor:
        """Network input (1, C, H, W) of the recording, as this or an equal classifier has it."""
        if self.classifier.card.kind == "haptic":
            x = classifier.haptic_input(self.recording)
        else:
            x = classifier.visual_input(self.recording)
        return like_weights(network_of(classifier), x)


def network_of(classifier: SurfaceClassifier) -> Network:
    """The network of a unimodal classifier."""
    return cast(Network, classifier.network)


def like_weights(network: Network, x: Tensor) -> Tensor:
    """An input in the precision and on the device of a network's first weights."""
    return x.to(next(network.parameters()))


def dense_pass(network: Network, tile: int | None) -> Callable[[Tensor], Tensor]:
    """What maps an input (1, C, H, W) to dense scores (1, classes, M, N), in pieces if need be.

    Args:
        network: Accelerated or as trained; a spectrogram's scores have one row.
        tile: Largest H * W of a piece, or None.
    """
    windows = layer_windows(network, 0), layer_windows(network, 1)

    def scores(x: Tensor) -> Tensor:
        found: Tensor = network(x)
        return found if found.dim() == 4 else found[:, :, None]

    return lambda x: in_tiles(scores, x, windows, tile)
