"""Pieces against the whole, for every network and sizes around the pieces' edges."""

import pytest
import torch
from conftest import visualnet
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from torch import nn

from tex_lightning.networks import HapticNet
from tex_lightning.networks.tiles import affordable, in_tiles, layer_windows, split_axis
from tex_lightning.networks.trunks import TRUNKS

NARROW = 0.03


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
@examples(max_examples=12)
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


@pytest.mark.parametrize("trunk", [name for name in TRUNKS if "efficientnet" in name])
@pytest.mark.parametrize(("height", "width"), [(2401, 300), (310, 2500), (1750, 1801)])
def test_pieces_of_a_large_photo_where_a_prediction_sees_much(trunk, height, width):
    net = network(trunk)
    x = torch.randn(1, 3, height, width, generator=torch.Generator().manual_seed(0))
    sizes = []

    def noted(piece):
        sizes.append(piece.shape[2] * piece.shape[3])
        return run(net, piece)

    found = in_tiles(noted, x, windows(net), 9 * height * width // 10)
    torch.testing.assert_close(found, run(net, x), rtol=1e-4, atol=1e-5)
    assert len(sizes) > 1
    assert max(sizes) < height * width


@examples(max_examples=40)
@given(st.integers(177, 1500), st.integers(12_000, 40_000))
def test_a_trace_in_pieces_has_the_class_scores_of_the_whole(frames, most):
    net = network("haptic")
    x = torch.randn(1, 1, 50, frames, generator=torch.Generator().manual_seed(frames))
    found = in_tiles(lambda piece: run(net, piece), x, windows(net), most)
    torch.testing.assert_close(found, run(net, x), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", [*TRUNKS, "haptic"])
def test_no_piece_is_larger_than_asked_where_that_is_possible(name):
    net = network(name)
    x = torch.zeros(1, 1 if name == "haptic" else 3, 50 if name == "haptic" else 2000, 2600)
    seen = []
    most = 40_000 if name == "haptic" else 500_000
    if name.startswith("efficientnet"):  # whose predictions see 1307 pixels along each axis
        most = 2_500_000

    def noted(piece):
        seen.append(piece.shape[2] * piece.shape[3])
        rows, columns = (sizes(layer_windows(net, axis), piece.shape[2 + axis]) for axis in (0, 1))
        return torch.zeros(1, 1, rows, columns)

    in_tiles(noted, x, windows(net), most)
    assert len(seen) > 2
    assert max(seen) <= most


@pytest.mark.parametrize("name", TRUNKS)
def test_the_pieces_of_a_large_photo_are_not_nearly_all_margin(name):
    layers, size, default = windows(network(name)), (2448, 3264), 2_000_000
    computed = []

    def noted(piece):
        computed.append(piece.shape[2] * piece.shape[3])
        return torch.zeros(1, 1, *(sizes(layers[axis], piece.shape[2 + axis]) for axis in (0, 1)))

    in_tiles(noted, torch.zeros(1, 1, *size), layers, affordable(layers, default))
    assert sum(computed) < 2 * size[0] * size[1]  # 178 times of EfficientNet-Lite2's before
    assert affordable(layers, None) is None
    assert affordable(layers, 10**9) == 10**9


def sizes(layers, size):
    for layer in layers:
        size = layer.output(size)
    return size


@pytest.mark.parametrize("name", [*TRUNKS, "haptic"])
@examples(max_examples=50)
@given(st.integers(700, 3000), st.integers(1, 6))
def test_pieces_cover_every_position_once(name, size, pieces):
    layers = layer_windows(network(name), 1)
    spans = split_axis(layers, size, pieces)
    positions = [p for span in spans for p in range(span.first, span.last)]
    assert positions == list(range(sizes(layers, size)))
    assert all(0 <= span.begin < span.end <= size for span in spans)
    for span in spans:
        given = sizes(layers, span.end - span.begin)
        assert given >= span.skip + span.last - span.first
