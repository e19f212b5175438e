"""The convolutional part of AlexNet, as trained in Caffe, and its first half for textures."""

from collections import OrderedDict
from typing import ClassVar

from torch import nn

from tex_lightning.networks.blocks import NORMS, Norm, Window, conv_block, response_norm, scaled
from tex_lightning.networks.trunks.base import Trunk

CAFFE_POOL = Window(3, 2, ceil=True)
AVERAGE = Window(13)  # of VisualNet-TCNN


def caffe_channels(width: float) -> tuple[int, ...]:
    """Return the scaled channel counts of conv1 to conv5, all even for the two groups."""
    return tuple(2 * scaled(channels // 2, width) for channels in (96, 256, 384, 384, 256))


def caffe_conv123(channels: tuple[int, ...], norm: Norm) -> OrderedDict[str, nn.Module]:
    """Return conv1 to conv3 of Caffe's AlexNet: each of the first two is normalised, then pooled.

    Args:
        channels: Channel counts of conv1, conv2 and conv3.
        norm: "lrn" is the published network; "batch" normalises what is pooled already.
    """
    one, two, three = channels
    first = conv_block(3, one, 11, norm=norm, stride=4)
    second = conv_block(one, two, 5, norm=norm, padding=2, groups=2)
    return OrderedDict(
        conv1=_pooled(first, *response_norm(norm)),
        conv2=_pooled(second, *response_norm(norm)),
        conv3=conv_block(two, three, 3, norm=norm, padding=1),
    )


def _pooled(block: nn.Sequential, *responses: nn.Module) -> nn.Sequential:
    """Add max pooling to a block: after response normalisation, if any, else after convolution."""
    conv, *rest = block
    if responses:
        return nn.Sequential(*block, *responses, CAFFE_POOL.max_pool())
    return nn.Sequential(conv, CAFFE_POOL.max_pool(), *rest)  # as HapticNet does


class CaffeAlexNet(Trunk):
    """AlexNet as in Caffe's bvlc_alexnet, the trunk of the paper's VisualNet.

    Caffe rounds pooled sizes up; with floor pooling a 224 input would end in 5x5, not 6x6.
    """

    norms = NORMS
    fc1_kernel = 6
    final = ("layers.conv5.0",)
    layouts: ClassVar = {"caffe": {f"conv{n}": f"layers.conv{n}.0" for n in range(1, 6)}}

    def build(self) -> nn.Sequential:
        """Return conv1 to conv5 with their poolings."""
        *early, four, five = caffe_channels(self.width)
        layers = caffe_conv123(tuple(early), self.norm)
        layers["conv4"] = conv_block(early[-1], four, 3, norm=self.norm, padding=1, groups=2)
        layers["conv5"] = _pooled(conv_block(four, five, 3, norm=self.norm, padding=1, groups=2))
        self.out_channels = five
        return nn.Sequential(layers)


class TcnnTrunk(Trunk):
    """conv1 to conv3 of Caffe's AlexNet in VisualNet's order, then average pooling over 13x13.

    The paper keeps VisualNet's first three convolutions, so the normalisation comes before the
    pooling here, where T-CNN-3 has it after. The paper gives no stride of the averaging; 1 is
    Caffe's default and T-CNN's.
    """

    norms = NORMS
    fc1_kernel = 1
    final = ("layers.conv3.0",)
    layouts: ClassVar = {"caffe": {f"conv{n}": f"layers.conv{n}.0" for n in range(1, 4)}}

    def build(self) -> nn.Sequential:
        """Return conv1 to conv3 with their poolings, and the average."""
        channels = caffe_channels(self.width)[:3]
        layers = caffe_conv123(channels, self.norm)
        layers["average"] = AVERAGE.average_pool()
        self.out_channels = channels[-1]
        return nn.Sequential(layers)
