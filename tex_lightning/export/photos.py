"""Turn photos as decoded from their files into the network's input."""

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d

from tex_lightning.export.movement import promise


class PhotoGraph(nn.Module):
    """Halve a photo as :func:`~tex_lightning.data.decode.halve` does, then its features.

    Args:
        features: Map (1, 3, height, width) uint8 to the network's input.
        half_scale: Whether photos are halved: the mean of 2x2 pixels, rounded half up.
        least: Pixels a side, before that, that one fragment takes.
    """

    def __init__(self, features: nn.Module, half_scale: bool, least: int) -> None:
        super().__init__()
        self.features, self.half_scale, self.least = features, half_scale, least

    def forward(self, photo: Tensor) -> Tensor:
        """Photo (height, width, 3) uint8 to network input (1, 3, height, width)."""
        height, width = (_open(size, self.least) for size in photo.shape[:2])
        planes = photo[:height, :width].permute(2, 0, 1)[None]
        if self.half_scale:  # a last row or column of an odd number is left out
            planes = (avg_pool2d(planes.float(), 2) + 0.5).to(torch.uint8)
        found: Tensor = self.features(planes)
        return found


def _open(size: int, least: int) -> Any:  # noqa: ANN401
    """A size as a value of which the tracer assumes nothing.

    Of a size as such it notes in passing that there is more than one row, as in its example.
    """
    found: Any = torch.scalar_tensor(size, dtype=torch.int64).item()
    promise(found >= least)
    promise(found <= size)
    return found
