"""A network of a user's own is trained in PyTorch's default layout."""

import pytest
import torch
from conftest import make_card
from torch import nn

from tex_lightning.learning.module import SurfaceModule, training_layout
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


def test_inputs_have_the_layout_of_the_weights(monkeypatch):
    fit = {"head_factor": 1.0}
    module = SurfaceModule(make_card("visual", width=0.1), fit, 0, {"visual": 40})
    crop = torch.zeros(2, 3, 60, 60, dtype=torch.uint8)
    batch = {"visual": {"crop": crop, "degrees": torch.zeros(2)}}
    (sense,) = module.classifier.senses.values()
    x = torch.zeros(2, 3, 40, 40).contiguous(memory_format=torch.channels_last)
    monkeypatch.setattr(type(sense), "training_input", lambda *_: x)
    assert module.inputs(batch)[0].is_contiguous(memory_format=torch.channels_last)
    module.layout = torch.contiguous_format
    assert module.inputs(batch)[0].is_contiguous()
