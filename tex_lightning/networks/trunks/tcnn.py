"""The trunk of VisualNet-TCNN: three convolutions of AlexNet and an average over each texture."""

from typing import ClassVar

from torch import nn

from tex_lightning.networks.blocks import NORMS, Window
from tex_lightning.networks.trunks.alexnet import (
    CAFFE_CONV1,
    CAFFE_POOL,
    caffe_channels,
    caffe_conv123,
)
from tex_lightning.networks.trunks.base import Trunk

AVERAGE = Window(13)


class TcnnTrunk(Trunk):
    """conv1 to conv3 of Caffe's AlexNet in VisualNet's order, then average pooling over 13x13.

    The paper keeps VisualNet's first three convolutions, so the normalisation comes before the
    pooling here, where T-CNN-3 has it after. The paper gives no stride of the averaging; 1 is
    Caffe's default and T-CNN's.
    """

    norms = NORMS
    geometry = (CAFFE_CONV1, CAFFE_POOL, CAFFE_POOL, AVERAGE)
    fc1_kernel = 1
    final = ("layers.conv3.0",)
    layouts: ClassVar = {"caffe": {f"conv{n}": f"layers.conv{n}.0" for n in range(1, 4)}}

    def build(self) -> nn.Sequential:
        """Return conv1 to conv3 with their poolings, and the average."""
        channels = caffe_channels(self.width)[:3]
        layers = caffe_conv123(channels, self.norm)
        # Over rows, then over columns: the same average with 26 additions instead of 169.
        layers["average"] = nn.Sequential(
            nn.AvgPool2d((AVERAGE.kernel, 1), AVERAGE.stride),
            nn.AvgPool2d((1, AVERAGE.kernel), AVERAGE.stride),
        )
        self.out_channels = channels[-1]
        return nn.Sequential(layers)
