"""The convolutional part of AlexNet, as trained in Caffe and as trained in torchvision."""

from collections import OrderedDict
from typing import ClassVar

from torch import nn

from tex_lightning.networks.blocks import (
    NORMS,
    Norm,
    Window,
    conv_block,
    response_norm,
    scaled,
)
from tex_lightning.networks.trunks.base import Trunk

CAFFE_CONV1 = Window(11, 4)
CAFFE_POOL = Window(3, 2, ceil=True)
TORCHVISION_CONV1 = Window(11, 4, padding=2)
TORCHVISION_POOL = Window(3, 2)


def caffe_channels(width: float) -> tuple[int, ...]:
    """Return the scaled channel counts of conv1 to conv5, all even for the two groups."""
    return tuple(2 * scaled(channels // 2, width) for channels in (96, 256, 384, 384, 256))


def caffe_conv123(channels: tuple[int, ...], norm: Norm) -> OrderedDict[str, nn.Module]:
    """Return conv1 to conv3 of Caffe's AlexNet: each of the first two is normalised, then pooled.

    Args:
        channels: Channel counts of conv1, conv2 and conv3.
        norm: "lrn" is the published network.
    """
    one, two, three = channels
    return OrderedDict(
        conv1=conv_block(3, one, CAFFE_CONV1.kernel, norm=norm, stride=CAFFE_CONV1.stride),
        pool1=nn.Sequential(*response_norm(norm), CAFFE_POOL.max_pool()),
        conv2=conv_block(one, two, 5, norm=norm, padding=2, groups=2),
        pool2=nn.Sequential(*response_norm(norm), CAFFE_POOL.max_pool()),
        conv3=conv_block(two, three, 3, norm=norm, padding=1),
    )


class CaffeAlexNet(Trunk):
    """AlexNet as in Caffe's bvlc_alexnet, the trunk of the paper's VisualNet.

    Caffe rounds pooled sizes up; with floor pooling a 224 input would end in 5x5, not 6x6.
    """

    norms = NORMS
    geometry = (CAFFE_CONV1, CAFFE_POOL, CAFFE_POOL, CAFFE_POOL)
    fc1_kernel = 6
    final = ("layers.conv5.0",)
    layouts: ClassVar = {"caffe": {f"conv{n}": f"layers.conv{n}.0" for n in range(1, 6)}}

    def build(self) -> nn.Sequential:
        """Return conv1 to conv5 with their poolings."""
        *early, four, five = caffe_channels(self.width)
        layers = caffe_conv123(tuple(early), self.norm)
        layers["conv4"] = conv_block(early[-1], four, 3, norm=self.norm, padding=1, groups=2)
        layers["conv5"] = conv_block(four, five, 3, norm=self.norm, padding=1, groups=2)
        layers["pool5"] = CAFFE_POOL.max_pool()
        self.out_channels = five
        return nn.Sequential(layers)


class TorchvisionAlexNet(Trunk):
    """AlexNet as in torchvision (the "one weird trick" variant): no groups, no LRN."""

    norms = ("batch", "none")
    geometry = (TORCHVISION_CONV1, TORCHVISION_POOL, TORCHVISION_POOL, TORCHVISION_POOL)
    fc1_kernel = 6
    final = ("layers.conv5.0",)
    layouts: ClassVar = {
        "torchvision": {
            f"features.{place}": f"layers.conv{n}.0" for n, place in enumerate((0, 3, 6, 8, 10), 1)
        }
    }
    imagenet_url = "https://download.pytorch.org/models/alexnet-owt-7be5be79.pth"
    imagenet_sha256 = "7be5be791159472b1fbf3c69796f7cb30dca7ad8466c2df70058c37116cdee02"

    def build(self) -> nn.Sequential:
        """Return conv1 to conv5 with their poolings."""
        one, two, three, four, five = (scaled(c, self.width) for c in (64, 192, 384, 256, 256))
        kernel, stride, padding, *_ = TORCHVISION_CONV1
        norm = self.norm
        self.out_channels = five
        return nn.Sequential(
            OrderedDict(
                conv1=conv_block(3, one, kernel, norm=norm, stride=stride, padding=padding),
                pool1=TORCHVISION_POOL.max_pool(),
                conv2=conv_block(one, two, 5, norm=norm, padding=2),
                pool2=TORCHVISION_POOL.max_pool(),
                conv3=conv_block(two, three, 3, norm=norm, padding=1),
                conv4=conv_block(three, four, 3, norm=norm, padding=1),
                conv5=conv_block(four, five, 3, norm=norm, padding=1),
                pool5=TORCHVISION_POOL.max_pool(),
            )
        )
