"""The twin for one window says of every window what the network says of that window alone."""

import pytest
import torch
from conftest import visualnet
from torch import nn

from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.trunks import TRUNKS
from tex_lightning.studies.profile import WindowNet, batches, cut_windows


def lively(network):
    """Weights, biases and statistics that no layer could drop unnoticed; evaluation mode."""
    generator = torch.Generator().manual_seed(0)
    for layer in network.modules():
        if isinstance(layer, nn.BatchNorm2d):
            layer.running_mean.normal_(generator=generator)
            layer.running_var.uniform_(0.5, 2, generator=generator)
        if isinstance(layer, nn.BatchNorm2d | nn.Conv2d) and layer.bias is not None:
            nn.init.normal_(layer.bias, std=0.3, generator=generator)
    nn.init.normal_(network.head.scores[1].weight, generator=generator)
    return network.eval()


def noise(*shape):
    return torch.randn(shape, generator=torch.Generator().manual_seed(1))


def cut(network, x):
    return cut_windows(x, network.window_size, network.stride)


@torch.no_grad()
def check_twin(network, x):
    grid = cut(network, x)
    alone = torch.cat([network(window[None]) for window in grid.flatten(0, 1)]).flatten(1)
    assert alone.shape == (grid.shape[0] * grid.shape[1], network.classes)
    twin = torch.cat([WindowNet(network)(batch) for batch in batches(grid, 3)])
    torch.testing.assert_close(twin, alone, rtol=1e-4, atol=1e-4)
    assert torch.equal(twin.argmax(1), alone.argmax(1))


@pytest.mark.parametrize("norm", ["batch", "lrn", "none"])
def test_the_twin_of_hapticnet_equals_the_network_on_each_window(norm):
    check_twin(lively(HapticNet(5, width=0.2, norm=norm)), noise(1, 1, 50, 230))


@pytest.mark.parametrize("trunk", TRUNKS)
def test_the_twin_of_visualnet_equals_the_network_on_each_window(trunk):
    network = lively(visualnet(5, trunk=trunk, width=0.125, norm="batch"))
    check_twin(network, noise(1, 3, 224, 224 + network.stride))


def test_windows_stand_where_the_predictions_do():
    haptic = HapticNet(3, width=0.1)
    grid = cut(haptic, noise(1, 1, 50, 1996))
    assert grid.shape == (1, 113, 1, 50, 192)  # and the 114th prediction has no full window
    visual = visualnet(3, width=0.1)
    x = torch.arange(3 * 300 * 400.0).reshape(1, 3, 300, 400)
    grid = cut(visual, x)
    assert grid.shape[:2] == (3, 6)
    assert torch.equal(grid[2, 5], x[0, :, 64 : 64 + 224, 160 : 160 + 224])
    rows, columns = visual.output_size(300, 400)
    assert (rows - 3, columns - 6) in {(0, 0), (0, 1), (1, 0), (1, 1)}
