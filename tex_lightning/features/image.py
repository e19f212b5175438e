"""From 8-bit photos to the normalised pixels that VisualNet reads, rotated while training."""

import math
from collections.abc import Iterator, Sequence

import torch
from kornia.geometry.transform import remap, rescale
from torch import Tensor, nn

MEAN = (0.485, 0.456, 0.406)  # of ImageNet's photos, R G B in [0, 1]
STD = (0.229, 0.224, 0.225)


class ImageFeatures(nn.Module):
    """Normalise RGB photos, at one or several scales; rotate training crops without black corners.

    Convention: input (batch, 3, height, width), uint8 0 to 255, red first; output float with
    ImageNet's mean and deviation removed, which is what every trunk expects. Angles are degrees,
    counter-clockwise.

    Args:
        scales: Factors on the side of a photo; the fragments of all of them vote together.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, scales: Sequence[float] = (1.0,)) -> None:
        super().__init__()
        self.scales = tuple(scales)
        self.register_buffer("mean", torch.tensor(MEAN).view(3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(STD).view(3, 1, 1), persistent=False)

    def forward(self, photos: Tensor) -> Tensor:
        """Photos to network input of the same size."""
        pixels = torch.div(photos, 255)  # a new tensor, so that the rest needs no more memory
        return pixels.sub_(self.mean).div_(self.std)

    def pyramid(self, photo: Tensor) -> Iterator[Tensor]:
        """A photo (height, width, 3) at every scale.

        Yields:
            Pixels (1, 3, height, width), 0 to 255: the photo itself where the scale is 1, else
            float, bilinearly interpolated and smoothed before it is made smaller.
        """
        pixels = photo.permute(2, 0, 1)[None]
        for scale in self.scales:
            if scale == 1:
                yield pixels
            else:
                yield rescale(pixels.float().contiguous(), scale, antialias=scale < 1)

    def rotated(
        self, crops: Tensor, degrees: Tensor, patch: int, zoom: Tensor | None = None
    ) -> Tensor:
        """Rotate crops about their centres and keep the middle ``patch`` pixels.

        Args:
            crops: uint8 (batch, 3, side, side) with ``side >= crop_side(patch, rotation)``.
            degrees: (batch,) angles.
            patch: Side of the result.
            zoom: (batch,) factors of enlargement; below 1 the border is repeated where the crop
                ends. None for 1.

        Returns:
            Network input (batch, 3, patch, patch).
        """
        middle = (crops.shape[-1] - 1) / 2
        offset = torch.arange(patch, device=crops.device) - (patch - 1) / 2
        angle = torch.deg2rad(degrees)[:, None, None]
        factor = torch.ones_like(angle) if zoom is None else zoom[:, None, None].to(angle)
        cos, sin, x, y = angle.cos() / factor, angle.sin() / factor, offset, offset[:, None]
        turned = remap(
            crops.contiguous().float(),  # planes of colours are turned faster than pixels
            middle + cos * x - sin * y,
            middle + sin * x + cos * y,
            padding_mode="border",
            align_corners=True,
        )
        pixels: Tensor = turned.sub_(255 * self.mean).div_(255 * self.std)
        return pixels


def crop_side(patch: int, rotation: float) -> int:
    """Side of the square from which a patch can be cut at any angle up to ``rotation`` degrees."""
    if rotation <= 0:
        return patch
    angle = math.radians(min(rotation, 45.0))
    return math.ceil(patch * (math.cos(angle) + math.sin(angle))) + 2
