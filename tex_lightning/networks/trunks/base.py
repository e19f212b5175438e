"""The base class of trunks: what a trunk declares, and the geometry that follows from it."""

from bisect import bisect_left
from collections.abc import Mapping
from contextlib import suppress
from copy import deepcopy
from math import prod
from typing import Annotated, ClassVar, Literal

import torch
from torch import Tensor, nn

from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import WIDTH, Norm, check_norm, initialise, is_builtin
from tex_lightning.networks.geometry import layer_windows, side_after

MAX_SIDE = 1 << 13  # pixels along an axis that are tried
MAX_COMPUTED = 1 << 10  # of an image that is computed for that
Layout = Literal["caffe", "efficientnet"]


class Trunk(nn.Module):
    """Convolutions that turn an image (B, 3, H, W) into features (B, out_channels, M', N').

    A trunk is one subclass in one file: class attributes, and a ``build`` method that returns the
    layers. Images are RGB in [0, 1], normalised with the ImageNet mean and standard deviation.

    Attributes:
        norms: Normalisations the trunk can be built with.
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

    Raises:
        UserError: ``norm`` is not one of ``norms``.
    """

    norms: ClassVar[tuple[Norm, ...]]
    fc1_kernel: int = 0  # unless a class says it: the side of the map of a patch
    patch: int = 224
    final: ClassVar[tuple[str, ...]] = ()
    textures: ClassVar[bool] = False
    layouts: ClassVar[Mapping[Layout, Mapping[str, str]]] = {}
    imagenet_package: ClassVar[str | None] = None
    imagenet_sha256: ClassVar[str | None] = None
    out_channels: int

    def __init__(
        self,
        *,
        width: Annotated[float, WIDTH, "factor on every channel count; 1 is the published size"],
        norm: Annotated[Norm, "normalisation of activations; none for pretrained trunks"],
    ) -> None:
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
        if is_builtin(self):  # whose layers tell it
            return side_after(layer_windows(self.layers, 0), side)
        values = vars(self)  # copies that are no part of it; on the meta device nothing is computed
        if "copies" not in values:
            values["copies"] = {"meta": deepcopy(self).to("meta"), "cpu": deepcopy(self).cpu()}
        for device, copy in values["copies"].items():
            if device == "meta" or side <= MAX_COMPUTED:  # of one that asks for values
                with suppress(Exception), torch.no_grad():  # of a kernel larger than its input
                    return int(copy(torch.zeros(2, 3, side, side, device=device)).shape[2])
        return 0

    def smallest_side(self, features: int) -> int:
        """Return the smallest image side in pixels whose feature map has side ``features``.

        Raises:
            UserError: If none has.
        """
        high = 1
        while self.output_side(high) < features:
            high *= 2
            if high > MAX_SIDE:
                with torch.no_grad():
                    self(torch.zeros(2, 3, self.patch, self.patch))  # says what is wrong with it
                raise UserError(
                    f"{type(self).__name__} makes no map of side {features} of any photo up to "
                    f"{MAX_SIDE} pixels; give it another fc1_kernel."
                )
        return bisect_left(range(high), features, key=self.output_side)

    @property
    def stride(self) -> int:
        """Pixels between neighbouring predictions."""
        return prod(window.stride for window in layer_windows(self.layers, 1))
