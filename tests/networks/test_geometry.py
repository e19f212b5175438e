"""Geometry that is found by trying, against what this package's networks declare."""

import pytest
import torch
from conftest import visualnet
from torch import nn
from torch.nn import functional

from tex_lightning.networks import HapticNet
from tex_lightning.networks.geometry import geometry_of, probe_geometry
from tex_lightning.networks.tiles import in_tiles

NARROW = 0.03


@pytest.mark.parametrize("name", ["haptic", "alexnet_caffe", "tcnn"])
def test_what_is_found_is_what_is_declared(name):
    torch.manual_seed(0)
    haptic = name == "haptic"
    network = HapticNet(3, width=NARROW) if haptic else visualnet(3, trunk=name, width=NARROW)
    example = torch.zeros(1, 1, 50, 1) if haptic else torch.zeros(1, 3, 8, 8)
    declared = geometry_of(network.eval(), lambda: example, rows_vary=not haptic)
    with torch.inference_mode():
        found = probe_geometry(network, example, rows_vary=not haptic)
    assert (found.min_size, found.window_size) == (declared.min_size, declared.window_size)
    assert found.stride == declared.stride == network.stride
    assert 0 <= found.receptive_field - declared.receptive_field < 2 * found.stride
    for width in range(found.min_size[1], found.min_size[1] + 70):
        height = 50 if haptic else width
        assert found.output_size(height, width) == network.output_size(height, width)


class Functional(nn.Module):
    """A network of which a function between its layers decides what can be cut."""

    def __init__(self, function):
        super().__init__()
        self.first, self.last = nn.Conv2d(1, 4, 5, 2, padding=1), nn.Conv2d(4, 3, 3)
        self.function = function

    def features(self, x, level):
        return self.last(self.function(self.first(x)))


@pytest.mark.parametrize(
    "function",
    [
        lambda x: functional.avg_pool2d(x, 4),
        lambda x: functional.max_pool2d(x, 3, 2, padding=1),
        lambda x: functional.avg_pool2d(x, 2, ceil_mode=True),
        lambda x: functional.pad(x, (3, 0, 3, 0)),
    ],
)
@torch.inference_mode()
def test_pieces_of_functional_pooling_give_the_scores_of_the_whole(function):
    network = Functional(function).eval()
    found = geometry_of(network, lambda: torch.zeros(1, 1, 64, 64), rows_vary=True)
    x = torch.randn(1, 1, 173, 210, generator=torch.Generator().manual_seed(1))
    sizes = []

    def run(piece):
        sizes.append(piece.shape)
        return network.features(piece, "fc3")

    torch.testing.assert_close(in_tiles(run, x, found.layers, 9000), run(x), rtol=1e-4, atol=1e-5)
    assert len(sizes) > 4
    assert run(x).shape[2:] == found.output_size(173, 210)


@pytest.mark.parametrize(
    "function",
    [
        lambda x: functional.adaptive_avg_pool2d(x, 7),
        lambda x: x - x.mean(dim=(2, 3), keepdim=True),
        lambda x: x * torch.linspace(0, 1, x.shape[3]),
        lambda x: functional.interpolate(x, scale_factor=4),
    ],
)
def test_what_sees_the_whole_input_is_not_cut(function):
    network = Functional(function).eval()
    assert geometry_of(network, lambda: torch.zeros(1, 1, 64, 64), rows_vary=True) is None
    network.window_size = network.min_size = (9, 9)  # says nothing
    network.stride, network.output_size = 1, lambda height, width: (1, 1)
    assert geometry_of(network, lambda: torch.zeros(1, 1, 64, 64), rows_vary=True) is None
