"""SqueezeNet v1.0, and texture features from its layers of every depth."""

from collections import OrderedDict
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from tex_lightning.networks.blocks import Norm, Window, conv_block, scaled
from tex_lightning.networks.trunks.base import Layout, Trunk
from tex_lightning.networks.trunks.textures import RootFeatures, fragment_positions

CONV1 = Window(7, 2)
POOL = Window(3, 2, ceil=True)
TO_FIRE9 = (CONV1, POOL, POOL, POOL)
SPACING = 112  # pixels of a fragment for every position of fire9 (16 pixels) to the next fragment
IMAGENET = 1000  # classes that conv10 scores
# Squeeze channels by fire number; v1.0 expands each by 4 on either side.
SQUEEZE = {2: 16, 3: 16, 4: 32, 5: 32, 6: 48, 7: 48, 8: 64, 9: 64}
POOL_AFTER = (4, 8)
# Layers whose maps are pooled, and the positions along each axis that one of fire9 stands for.
TEXTURES = {"fire4": 4, "fire5": 2, "fire6": 2, "fire7": 2, "fire8": 2, "fire9": 1, "conv10": 1}

_TORCHVISION_PLACE = {2: 3, 3: 4, 4: 5, 5: 7, 6: 8, 7: 9, 8: 10, 9: 12}
_CAFFE_BRANCH = {"squeeze": "conv1x1_1", "expand1x1": "conv1x1_2", "expand3x3": "conv3x3_2"}


def _names(layout: Layout) -> dict[str, str]:
    """Map the names of the convolutions in a weight file to the names in the trunk."""
    caffe = layout == "caffe"
    names = {"conv1" if caffe else "features.0": "layers.conv1.0"}
    names["conv_final" if caffe else "classifier.1"] = "layers.conv10.0"
    for fire in SQUEEZE:
        for branch, caffe_name in _CAFFE_BRANCH.items():
            place = f"features.{_TORCHVISION_PLACE[fire]}.{branch}"
            name = f"fire{fire}__{caffe_name}" if caffe else place
            names[name] = f"layers.fire{fire}.{branch}.0"
    return names


class Fire(nn.Module):
    """Squeeze to few channels, then expand by 1x1 and by 3x3 convolutions side by side."""

    def __init__(self, inputs: int, squeeze: int, expand: int, norm: Norm) -> None:
        super().__init__()
        self.squeeze = conv_block(inputs, squeeze, 1, norm=norm)
        self.expand1x1 = conv_block(squeeze, expand, 1, norm=norm)
        self.expand3x3 = conv_block(squeeze, expand, 3, norm=norm, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, inputs, M, N) to (B, 2 * expand, M, N)."""
        squeezed = self.squeeze(x)
        return torch.cat([self.expand1x1(squeezed), self.expand3x3(squeezed)], dim=1)


def _pooling(patch: int) -> Window:
    """Pooling over the positions of a fragment in fire9; fragments overlap by some six sevenths."""
    return Window(fragment_positions(TO_FIRE9, patch, "squeezenet"), max(1, patch // SPACING))


class SqueezeNetTrunk(Trunk):
    """SqueezeNet v1.0 (Iandola et al. 2016) as texture features.

    Fire4 to fire9 and conv10, which scores ImageNet's classes, give 3304 features over windows of
    fire9's positions, one vector for a ``patch``: 13x13 positions for 224 pixels.

    Args:
        width: Factor on every channel count.
        norm: One of ``norms``.
        patch: Side in pixels of a fragment. Half of it on halved photos sees the same surface for a
            quarter of the arithmetic.

    Raises:
        UserError: ``norm`` is not one of ``norms``, or ``patch`` is smaller than a position.
    """

    norms = ("batch", "none")
    geometry = (*TO_FIRE9, _pooling(Trunk.patch))
    fc1_kernel = 1
    textures = True
    final = ("layers.fire9.expand1x1.0", "layers.fire9.expand3x3.0")
    layouts: ClassVar = {"caffe": _names("caffe"), "torchvision": _names("torchvision")}
    imagenet_url = "https://download.pytorch.org/models/squeezenet1_0-b66bff10.pth"
    imagenet_sha256 = "b66bff10"  # torchvision publishes no more than the name's digits

    def __init__(self, *, width: float, norm: Norm, patch: int = Trunk.patch) -> None:
        self.patch, self.geometry = patch, (*TO_FIRE9, _pooling(patch))
        super().__init__(width=width, norm=norm)

    def build(self) -> nn.Sequential:
        """Return conv1, fire2 to fire9 with their poolings, and the pooled features."""
        source, self.out_channels = scaled(96, self.width), 0
        layers: OrderedDict[str, nn.Module] = OrderedDict(
            conv1=conv_block(3, source, CONV1.kernel, norm=self.norm, stride=CONV1.stride),
            pool1=POOL.max_pool(),
        )
        for fire, channels in SQUEEZE.items():
            squeeze, expand = scaled(channels, self.width), scaled(4 * channels, self.width)
            layers[f"fire{fire}"] = Fire(source, squeeze, expand, self.norm)
            if fire in POOL_AFTER:
                layers[f"pool{fire}"] = POOL.max_pool()
            source = 2 * expand
            self.out_channels += source if f"fire{fire}" in TEXTURES else 0
        scores = scaled(IMAGENET, self.width)
        layers["conv10"] = conv_block(source, scores, 1, norm=self.norm)
        self.out_channels += scores
        layers["features"] = RootFeatures(self.geometry[-1], self.out_channels)
        return nn.Sequential(layers)

    def forward(self, x: Tensor) -> Tensor:
        """Map an image (B, 3, H, W) to features (B, out_channels, M', N')."""
        features: Any = self.layers.features
        pooled = []
        for name, layer in list(self.layers.named_children())[:-1]:
            x = layer(x)
            if name in TEXTURES:  # at once, so that no map is kept
                pooled.append(features.pooled(x, TEXTURES[name]))
        standardised: Tensor = features(pooled)
        return standardised
