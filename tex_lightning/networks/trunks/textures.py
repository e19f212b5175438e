"""Texture features: means of the maps of several layers over the same windows of an image."""

from collections.abc import Sequence
from itertools import count

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d

from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import Window
from tex_lightning.networks.trunks.base import side_after

MIN_DEVIATION = 0.1  # most are 0.2 to 7


def fragment_positions(windows: Sequence[Window], patch: int, name: str) -> int:
    """Positions of the coarsest maps along each axis of a fragment.

    Args:
        windows: Windows of the layers up to these maps.
        patch: Side of a fragment in pixels.
        name: Name of the trunk, for the message.

    Raises:
        UserError: If a fragment is smaller than a position.
    """
    positions = side_after(windows, patch)
    if positions < 1:
        least = next(side for side in count(1) if side_after(windows, side))
        raise UserError(
            f"model.visual.trunk.patch={patch} is less than one position of {name}; choose "
            f"{least} pixels or more."
        )
    return positions


class TextureFeatures(nn.Module):
    """Mean of every channel of several layers over the same windows of the image.

    What a texture is shows at every depth, from fine grain to whole motifs. The mean over a window
    forgets where.

    Args:
        window: Window of positions of the coarsest maps, of which a fragment consists.
        channels: Channels of all layers together, D.

    Attributes:
        mean: (D,) of the features over photos of surfaces, 0 until :meth:`standardise`.
        scale: (D,) that they are divided by, 1 until then.
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, window: Window, channels: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(channels))
        self.register_buffer("scale", torch.ones(channels))
        # Rows, then columns: a quarter of the additions.
        self.average = nn.Sequential(
            nn.AvgPool2d((window.kernel, 1), (window.stride, 1)),
            nn.AvgPool2d((1, window.kernel), (1, window.stride)),
        )

    def pooled(self, maps: Tensor, positions: int) -> Tensor:
        """Average one layer's maps over every window.

        Args:
            maps: (B, D, M, N).
            positions: Those along each axis that one of the coarsest maps stands for.

        Returns:
            (B, D, M', N').
        """
        averages: Tensor = self.average(avg_pool2d(maps, positions))
        return averages

    def forward(self, pooled: Sequence[Tensor]) -> Tensor:
        """Put what :meth:`pooled` gave for each layer side by side, standardised."""
        features = torch.cat(list(pooled), dim=1)
        return (features - self.mean[:, None, None]) / self.scale[:, None, None]

    def standardise(self, features: Tensor) -> Tensor:
        """Let features (rows, D) as they come have mean 0 and unit length from now on; return them.

        Every feature counts alike, but for one that hardly varies, which would be all noise.
        """
        self.mean.copy_(features.mean(dim=0))
        variance = features.var(dim=0, correction=0)
        self.scale.copy_(((variance + MIN_DEVIATION**2) * features.shape[1]).sqrt())
        return (features - self.mean) / self.scale
