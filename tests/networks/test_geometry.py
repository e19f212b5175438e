"""Geometry that is found by trying, against what networks declare; pieces against the whole."""

import pytest
import torch
from conftest import visualnet
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from torch import nn
from torch.nn import functional

from tex_lightning.networks import HapticNet
from tex_lightning.networks.geometry import (
    affordable,
    geometry_of,
    in_tiles,
    layer_windows,
    side_after,
)
from tex_lightning.networks.trunks import TRUNKS

NARROW = 0.03


class Functional(nn.Module):
    """A network of which a function between its layers decides what can be cut."""

    def __init__(self, function):
        super().__init__()
        self.first, self.function = nn.Conv2d(1, 4, 5, 2, padding=1), function
        self.last = nn.Conv2d(4, 3, 3)

    def features(self, x, level):
        return self.last(self.function(self.first(x)))


@pytest.mark.parametrize(
    "layer",
    [
        nn.AvgPool2d(4),
        nn.MaxPool2d(3, 2, padding=1),
        nn.AvgPool2d(2, ceil_mode=True),
        nn.Sequential(nn.Conv2d(4, 4, 3, padding=1), nn.ReLU()),
    ],
)
@torch.inference_mode()
def test_pieces_of_other_networks_give_the_scores_of_the_whole(layer):
    network = Functional(layer).eval()
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
        lambda x: functional.avg_pool2d(x, 4),  # which no layer tells
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


def network(name: str) -> nn.Module:
    torch.manual_seed(0)
    norm = "lrn" if name == "haptic" or "lrn" in TRUNKS[name].norms else "none"
    net = (
        HapticNet(3, width=NARROW, norm="lrn")
        if name == "haptic"
        else visualnet(3, trunk=name, width=NARROW, norm=norm)
    )
    for layer in net.modules():
        if isinstance(layer, nn.Conv2d):  # zero biases would hide what padding does
            nn.init.normal_(layer.bias, std=0.5)
    return net.eval().requires_grad_(False)


def run(net: nn.Module, x: torch.Tensor) -> torch.Tensor:
    y = net(x)
    return y if y.ndim == 4 else y[:, :, None]


def windows(net: nn.Module):
    return layer_windows(net, 0), layer_windows(net, 1)


LARGER = ("efficientnet_lite2",)  # as efficientnet_lite0, and slower
CASES = [pytest.param(each, marks=pytest.mark.slow) if each in LARGER else each for each in TRUNKS]


@pytest.mark.parametrize("trunk", CASES)
@examples(max_examples=5)
@given(st.integers(230, 700), st.integers(230, 700), st.integers(55_000, 250_000))
def test_a_photo_in_pieces_has_the_class_scores_of_the_whole(trunk, height, width, most):
    net = network(trunk)
    x = torch.randn(1, 3, height, width, generator=torch.Generator().manual_seed(height))
    seen = []

    def noted(piece):
        seen.append(piece.shape[2] * piece.shape[3])
        return run(net, piece)

    expected = run(net, x)
    found = in_tiles(noted, x, windows(net), most)
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)
    assert len(seen) > 1 or height * width <= most or expected.numel() == 3


@examples(max_examples=10)
@given(st.integers(177, 1500), st.integers(12_000, 40_000))
def test_a_trace_in_pieces_has_the_class_scores_of_the_whole(frames, most):
    net = network("haptic")
    x = torch.randn(1, 1, 50, frames, generator=torch.Generator().manual_seed(frames))
    found = in_tiles(lambda piece: run(net, piece), x, windows(net), most)
    torch.testing.assert_close(found, run(net, x), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", TRUNKS)
def test_the_pieces_of_a_large_photo_are_not_nearly_all_margin(name):
    layers, size, default = windows(network(name)), (2448, 3264), 2_000_000
    computed = []

    def noted(piece):
        computed.append(piece.shape[2] * piece.shape[3])
        return torch.zeros(
            1, 1, *(side_after(layers[axis], piece.shape[2 + axis]) for axis in (0, 1))
        )

    in_tiles(noted, torch.zeros(1, 1, *size), layers, affordable(layers, default))
    assert sum(computed) < 2 * size[0] * size[1]  # 178 times of EfficientNet-Lite2's before
