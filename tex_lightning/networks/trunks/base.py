"""The declarations of every trunk of VisualNet, and the geometry that follows from them."""

from collections.abc import Mapping
from math import prod
from typing import ClassVar, Literal

import torch
from torch import Tensor, nn

from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import Norm, Window, check_norm, initialise, is_builtin
from tex_lightning.networks.geometry import (
    MAX_SIDE,
    map_sizes,
    measure_steps,
    side_after,
    smallest,
)

Layout = Literal["caffe", "efficientnet"]


class Trunk(nn.Module):
    """Convolutions that turn an image (B, 3, H, W) into features (B, out_channels, M', N').

    A trunk is one subclass in one file: class attributes, and a ``build`` method that returns the
    layers. Images are RGB in [0, 1], normalised with the ImageNet mean and standard deviation.

    Attributes:
        norms: Normalisations the trunk can be built with.
        geometry: The layers that change the side of the map, in order; only those of this package's
            trunks are read, and the sides of any other's maps are measured.
        fc1_kernel: Side of FC1's kernel that makes one prediction out of a ``patch``: that of its
            map.
        patch: Side in pixels of an input that gives one prediction.
        final: Names of the convolutions of the last map before the features, for weight files.
        textures: Whether the features are statistics of textures, one vector for a ``patch``,
            which FC3 can score as they are.
        layouts: For each layout of weight files, the file's name of every convolution here, that
            on pixels first; empty where there are none.
        imagenet_package: Package of Python that holds ImageNet weights as its only file
            ``models/*.pth``, if there is one.
        imagenet_sha256: SHA-256 of that file.
        out_channels: Channel count of the features.

    Args:
        width: Factor on every channel count.
        norm: One of ``norms``.

    Raises:
        UserError: ``norm`` is not one of ``norms``.
    """

    norms: ClassVar[tuple[Norm, ...]]
    geometry: tuple[Window, ...] = ()
    fc1_kernel: int = 0  # unless a class says it: the side of the map of a patch
    patch: int = 224
    final: ClassVar[tuple[str, ...]] = ()
    textures: ClassVar[bool] = False
    layouts: ClassVar[Mapping[Layout, Mapping[str, str]]] = {}
    imagenet_package: ClassVar[str | None] = None
    imagenet_sha256: ClassVar[str | None] = None
    out_channels: int

    def __init__(self, *, width: float, norm: Norm) -> None:
        super().__init__()
        check_norm(norm, self.norms, "model.visual.norm")
        self.width = width
        self.norm: Norm = norm
        self.layers = self.build()
        initialise(self.layers)
        self.fc1_kernel = self.fc1_kernel or self.output_side(self.patch) or 1

    def build(self) -> nn.Sequential:
        """Return the layers, and set ``out_channels``."""
        raise NotImplementedError

    def forward(self, x: Tensor) -> Tensor:
        """Map an image (B, 3, H, W) to features (B, out_channels, M', N')."""
        features: Tensor = self.layers(x)
        return features

    def output_side(self, side: int) -> int:
        """Return the side of the feature map of an image of ``side`` pixels; 0 if too small."""
        if is_builtin(self):
            return side_after(self.geometry, side)
        found = map_sizes(self)((2, 3, side, side))
        return 0 if found is None else found[0]

    def smallest_side(self, features: int) -> int:
        """Return the smallest image side in pixels whose feature map has side ``features``.

        Raises:
            UserError: If none has.
        """
        found = smallest(self.output_side, features)
        if found is None:
            with torch.no_grad():
                self(torch.zeros(2, 3, self.patch, self.patch))  # which says what is wrong with it
            raise UserError(
                f"{type(self).__name__} makes no map of side {features} of any photo up to "
                f"{MAX_SIDE} pixels; give it another fc1_kernel."
            )
        return found

    @property
    def min_side(self) -> int:
        """Smallest image side in pixels that gives one prediction."""
        return self.smallest_side(self.fc1_kernel)

    @property
    def stride(self) -> int:
        """Pixels between neighbouring predictions; 0 where they are at no even distances."""
        if is_builtin(self):
            return prod(window.stride for window in self.geometry)
        steps = measure_steps(self.output_side)
        return 0 if steps is None else steps.stride
