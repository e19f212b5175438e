"""The convolutional part of VGG-M, the medium network of Chatfield et al. (2014)."""

from collections import OrderedDict
from typing import ClassVar

from torch import nn

from tex_lightning.networks.blocks import NORMS, Norm, Window, conv_block, response_norm, scaled
from tex_lightning.networks.trunks.base import Trunk

POOL = Window(3, 2, ceil=True)


def _pool(norm: Norm) -> nn.Sequential:
    """Return normalisation with VGG's values, then pooling.

    Caffe and PyTorch divide alpha by the 5 channels; MatConvNet's files have 1e-4 for it.
    """
    return nn.Sequential(*response_norm(norm, alpha=5e-4, k=2.0), POOL.max_pool())


class VggMTrunk(Trunk):
    """VGG-M (Chatfield et al., "Return of the Devil in the Details", BMVC 2014).

    Maps of a 224 input have the sides 109, 54, 26, 13 and 6; pooled sizes are rounded up.
    """

    norms = NORMS
    fc1_kernel = 6
    final = ("layers.conv5.0",)
    layouts: ClassVar = {"caffe": {f"conv{n}": f"layers.conv{n}.0" for n in range(1, 6)}}

    def build(self) -> nn.Sequential:
        """Return conv1 to conv5 with their poolings."""
        one, two, three, four, five = (scaled(c, self.width) for c in (96, 256, 512, 512, 512))
        norm = self.norm
        self.out_channels = five
        return nn.Sequential(
            OrderedDict(
                conv1=conv_block(3, one, 7, norm=norm, stride=2),
                pool1=_pool(norm),
                conv2=conv_block(one, two, 5, norm=norm, stride=2, padding=1),
                pool2=_pool(norm),
                conv3=conv_block(two, three, 3, norm=norm, padding=1),
                conv4=conv_block(three, four, 3, norm=norm, padding=1),
                conv5=conv_block(four, five, 3, norm=norm, padding=1),
                pool5=POOL.max_pool(),
            )
        )
