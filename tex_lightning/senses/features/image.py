"""Turn 8-bit photos into the normalised pixels that VisualNet reads, rotated while training."""

import math
from collections.abc import Iterator

import torch
from torch import Tensor, nn

from tex_lightning.networks.blocks import MEAN, STD


class ImageFeatures(nn.Module):
    """Normalise RGB photos; rotate training crops without black corners.

    Convention: input (batch, 3, height, width), uint8 0 to 255, red first; output float with
    ImageNet's mean and deviation removed, which is what every trunk expects. Angles are degrees,
    counter-clockwise.
    """

    mean: Tensor
    std: Tensor
    scale: Tensor
    shift: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", torch.tensor(MEAN).view(3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(STD).view(3, 1, 1), persistent=False)
        # the same in one pass
        self.register_buffer("scale", 1 / (255 * self.std), persistent=False)
        self.register_buffer("shift", -self.mean / self.std, persistent=False)

    def forward(self, photos: Tensor) -> Tensor:
        """Normalise photos to network input of the same size."""
        pixels = torch.div(photos, 255)  # a new tensor, so that the rest needs no more memory
        return pixels.sub_(self.mean).div_(self.std)

    def rotated(self, crops: Tensor, degrees: Tensor, patch: int) -> Tensor:
        """Rotate crops about their centres to network input (batch, 3, patch, patch).

        Args:
            crops: uint8 (batch, 3, side, side) with ``side >= crop_side(patch, rotation)``.
            degrees: (batch,) angles.
            patch: Pixels in the middle that are kept along each axis.
        """
        turned = self.mean.new_empty(len(crops), 3, patch, patch)
        for result, pixels in _turned(crops, degrees, turned):
            torch.addcmul(self.shift, pixels, self.scale, out=result)
        return turned


def rotated_photos(crops: Tensor, degrees: Tensor, patch: int) -> Tensor:
    """Rotate crops as :meth:`ImageFeatures.rotated`, to photos (batch, 3, patch, patch) uint8."""
    turned = crops.new_empty(len(crops), 3, patch, patch)
    for result, pixels in _turned(crops, degrees, turned):
        result.copy_(pixels.round_())
    return turned


def _turned(crops: Tensor, degrees: Tensor, turned: Tensor) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield places in results (batch, 3, patch, patch), and pixels 0 to 255 of crops for them."""
    patch = turned.shape[-1]
    half = (crops.shape[-1] - 1) / 2  # from the centre to the middle of the last pixel
    offset = (torch.arange(patch, device=crops.device) - (patch - 1) / 2) / half
    angle = torch.deg2rad(degrees)[:, None, None]
    from kornia.geometry.transform import remap  # half a second, which predictions do without

    places = angle.cos() * offset, angle.sin() * offset  # of one row (batch, 1, patch) at its angle
    # together: a photo for each thread of a CPU and its cache
    count = torch.get_num_threads() if crops.device.type == "cpu" else max(1, len(crops))
    pieces = (torch.split(values, count) for values in (turned, crops, *places))
    for result, some, cos, sin in zip(*pieces, strict=True):
        # side by side, as remap wants them: from two planes its own copy takes twice as long
        grid = cos.new_empty(len(some), patch, patch, 2)
        pixels = remap(
            some.contiguous().to(cos.dtype),  # planes of colours are turned faster than pixels
            torch.sub(cos, sin.mT, out=grid[..., 0]),
            torch.add(sin, cos.mT, out=grid[..., 1]),
            padding_mode="border",
            align_corners=True,
            normalized_coordinates=True,  # -1 to 1; from pixels it is two more passes
        )
        yield result, pixels


def crop_side(patch: int, rotation: float) -> int:
    """Return the side of a square to cut a patch from at any angle up to ``rotation``."""
    if rotation <= 0:
        return patch
    angle = math.radians(min(rotation, 45.0))
    return math.ceil(patch * (math.cos(angle) + math.sin(angle))) + 2
