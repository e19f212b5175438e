"""VisualNet against the paper, the published networks and its own crops."""

import pytest
import torch
from conftest import visualnet

from tex_lightning.errors import UserError
from tex_lightning.networks.trunks import TRUNKS

NARROW = 0.05
SINGLE_OUTPUT = {
    "alexnet_caffe": (199, 230),
    "tcnn": (215, 230),
    "vgg_m": (201, 232),
    "efficientnet_lite0": (224, 255),
    "efficientnet_lite2": (224, 255),
}


def parameters(module):
    return sum(p.numel() for p in module.parameters())


@pytest.mark.parametrize(
    ("trunk", "norm", "fc1_kernel", "count"),
    [
        ("alexnet_caffe", "lrn", None, 5_191_749),
        ("alexnet_caffe", "lrn", 1, 2_503_749),
        ("tcnn", "lrn", None, 1_435_589),
    ],
)
def test_paper_parameter_counts(trunk, norm, fc1_kernel, count):
    assert parameters(visualnet(69, trunk=trunk, norm=norm, fc1_kernel=fc1_kernel)) == count


@pytest.mark.parametrize("trunk", TRUNKS)
def test_one_prediction_for_a_patch(trunk):
    net = visualnet(3, trunk=trunk, width=NARROW).eval()
    assert net(torch.zeros(1, 3, 224, 224)).shape == (1, 3, 1, 1)
    assert net.window_size == (224, 224)
    low, high = SINGLE_OUTPUT[trunk]
    single = [side for side in range(1, 300) if net.output_size(side, side) == (1, 1)]
    assert single == list(range(low, high + 1))
    assert net.min_size == (low, low)


@pytest.mark.parametrize("trunk", TRUNKS)
def test_output_size_matches_the_forward_pass(trunk):
    net = visualnet(2, trunk=trunk, width=0.02).eval()
    least = net.min_size[0]
    for step in range(0, 70, 3):
        height, width = least + step, least + 69 - step
        assert net(torch.zeros(1, 3, height, width)).shape[2:] == net.output_size(height, width)
    assert net.output_size(least - 1, 400)[0] == 0
    assert net.output_size(20, 5) == (0, 0)
    grown = net.output_size(1000 + net.stride, 1000)
    assert grown == (net.output_size(1000, 1000)[0] + 1, net.output_size(1000, 1000)[1])


def test_literal_1x1_fc1_gives_36_predictions():
    net = visualnet(3, width=NARROW, fc1_kernel=1).eval()
    assert net(torch.zeros(1, 3, 224, 224)).shape == (1, 3, 6, 6)
    assert net.output_size(224, 224) == (6, 6)
    assert net(torch.zeros(1, 3, *net.min_size)).shape == (1, 3, 1, 1)
    assert net.window_size == net.min_size
    assert net.output_size(net.min_size[0] - 1, 224)[0] == 0


def test_tcnn_features_are_plain_averages():
    torch.manual_seed(0)
    trunk = TRUNKS["tcnn"](width=NARROW, norm="none").double()
    x = torch.rand(1, 3, 240, 250, dtype=torch.float64)
    conv3 = trunk.layers[:-1](x)
    rows, columns = trunk.output_side(240), trunk.output_side(250)
    for row in range(rows):
        for column in range(columns):
            mean = conv3[..., row : row + 13, column : column + 13].mean((2, 3))
            torch.testing.assert_close(trunk(x)[..., row, column], mean)


@pytest.mark.parametrize("trunk", TRUNKS)
def test_every_parameter_learns(trunk):
    torch.manual_seed(0)
    head = [] if TRUNKS[trunk].textures else (300, 250)  # as they are used
    net = visualnet(3, trunk=trunk, width=0.1, head=head)
    net(torch.randn(2, 3, 224, 224)).square().sum().backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in net.parameters())


def test_lrn_is_only_for_caffe_trunks():
    with pytest.raises(UserError, match=r"model\.visual\.norm=lrn .*batch, none\."):
        visualnet(3, trunk="efficientnet_lite0", norm="lrn")
