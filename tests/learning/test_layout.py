"""A network of a user's own is trained in PyTorch's default layout."""

import pytest
import torch
from torch import nn

from tex_lightning.learning.module import training_layout
from tex_lightning.networks.trunks import TRUNKS, published


def test_layers_of_others_keep_pytorchs_layout():
    """The gradient of a convolution of kernel 1 and stride 2 ends the process in channels last."""
    layers = nn.Sequential(nn.Conv2d(3, 8, 3, padding=1), nn.Conv2d(8, 16, 1, 2))
    assert training_layout(layers) is torch.contiguous_format


@pytest.mark.parametrize("name", TRUNKS)
def test_no_trunk_in_channels_last_has_such_a_convolution(name):
    with torch.device("meta"):
        trunk = published(name)
    assert training_layout(trunk) is torch.channels_last
    layers = [each for each in trunk.modules() if isinstance(each, nn.Conv2d)]
    assert not any(each.kernel_size == (1, 1) and each.stride != (1, 1) for each in layers)
