"""SqueezeNet v1.0 up to fire9, with average and maximum pooling of its texture features."""

from collections import OrderedDict
from typing import ClassVar

import torch
from torch import Tensor, nn

from tex_lightning.networks.blocks import Norm, Window, conv_block, scaled
from tex_lightning.networks.trunks.base import Layout, Trunk

CONV1 = Window(7, 2)
POOL = Window(3, 2, ceil=True)
POOL_FEATURES = Window(13, 2)  # the whole fire9 map of a 224 input; stride 2 is 32 pixels
# Squeeze channels by fire number; v1.0 expands each by 4 on either side.
SQUEEZE = {2: 16, 3: 16, 4: 32, 5: 32, 6: 48, 7: 48, 8: 64, 9: 64}
POOL_AFTER = (4, 8)

_TORCHVISION_PLACE = {2: 3, 3: 4, 4: 5, 5: 7, 6: 8, 7: 9, 8: 10, 9: 12}
_CAFFE_BRANCH = {"squeeze": "conv1x1_1", "expand1x1": "conv1x1_2", "expand3x3": "conv3x3_2"}


def _names(layout: Layout) -> dict[str, str]:
    """Map the names of the convolutions in a weight file to the names in the trunk."""
    caffe = layout == "caffe"
    names = {"conv1" if caffe else "features.0": "layers.conv1.0"}
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


class PoolFeatures(nn.Module):
    """Roots of the average and the maximum over the same windows, one after the other.

    The root keeps a few strong features from outweighing all others (Perronnin et al. 2010, for
    Fisher vectors).

    Attributes:
        power: That the features are raised to; with it a checkpoint of features without roots
            cannot be mistaken for one of these.
    """

    power: Tensor

    def __init__(self, window: Window) -> None:
        super().__init__()
        self.register_buffer("power", torch.tensor(0.5))
        self.average = nn.AvgPool2d(window.kernel, window.stride)
        self.maximum = window.max_pool()

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, D, M, N) to (B, 2 * D, M', N')."""
        return torch.cat([self.average(x), self.maximum(x)], dim=1).clamp_(min=1e-8).sqrt_()


class SqueezeNetTrunk(Trunk):
    """SqueezeNet v1.0 (Iandola et al. 2016) without its classifier, as texture features.

    Average pooling keeps how strong a feature is over a patch and max pooling whether it occurs;
    both over 13x13 positions of fire9 give 1024 features, one vector for a 224 input.
    """

    norms = ("batch", "none")
    geometry = (CONV1, POOL, POOL, POOL, POOL_FEATURES)
    fc1_kernel = 1
    final = ("layers.fire9.expand1x1.0", "layers.fire9.expand3x3.0")
    layouts: ClassVar = {"caffe": _names("caffe"), "torchvision": _names("torchvision")}
    imagenet_url = "https://download.pytorch.org/models/squeezenet1_0-b66bff10.pth"

    def build(self) -> nn.Sequential:
        """Return conv1, fire2 to fire9 with their poolings, and the pooled features."""
        source = scaled(96, self.width)
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
        layers["features"] = PoolFeatures(POOL_FEATURES)
        self.out_channels = 2 * source
        return nn.Sequential(layers)
