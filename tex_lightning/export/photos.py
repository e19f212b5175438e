"""Photos as they come out of their files, to the network's input."""

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d


class PhotoGraph(nn.Module):
    """Halve a photo as :func:`~tex_lightning.data.decode.halve` does, then its features.

    Args:
        features: Map (1, 3, height, width) uint8 to the network's input.
        half_scale: Whether photos are halved: the mean of 2x2 pixels, rounded half up.
    """

    def __init__(self, features: nn.Module, half_scale: bool) -> None:
        super().__init__()
        self.features, self.half_scale = features, half_scale

    def forward(self, photo: Tensor) -> Tensor:
        """Photo (height, width, 3) uint8 to network input (1, 3, height, width)."""
        planes = photo.permute(2, 0, 1)[None]
        if self.half_scale:  # a last row or column of an odd number is left out
            planes = (avg_pool2d(planes.float(), 2) + 0.5).to(torch.uint8)
        found: Tensor = self.features(planes)
        return found
