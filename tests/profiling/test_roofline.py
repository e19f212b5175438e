import pytest
import torch
from torch import nn

from tex_lightning.inference.costs import count_macs
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.profiling.roofline import SHAPES, Pass, gemm_gflops, layers, products
from tex_lightning.profiling.timing import Timing

CPU = torch.device("cpu")


def small_network() -> nn.Sequential:
    return nn.Sequential(
        nn.Sequential(nn.Conv2d(3, 4, 3, padding=1), nn.BatchNorm2d(4), nn.ReLU()),
        nn.Dropout(),
        nn.Conv2d(4, 5, 1),
    ).eval()


def over(network: nn.Module, x: torch.Tensor) -> Pass:
    return Pass(network, lambda: network(x))


def test_macs_are_those_of_the_textbook():
    network, x = small_network(), torch.zeros(1, 3, 10, 12)
    expected = 10 * 12 * (4 * 3 * 9 + 5 * 4)
    assert count_macs(lambda: network(x)) == expected


def test_layers_add_up_to_the_network_and_name_its_parts():
    network, x = small_network(), torch.randn(1, 3, 10, 12)
    found = layers(over(network, x), over(network, x), rate=100.0, repeats=2)
    assert [layer.name for layer in found] == ["0.0", "0.1", "0.2", "2"]
    assert [layer.kind for layer in found] == ["Conv2d", "BatchNorm2d", "ReLU", "Conv2d"]
    assert sum(layer.macs for layer in found) == count_macs(lambda: network(x))
    conv = found[0]
    assert conv.macs == 10 * 12 * 4 * 3 * 9
    assert conv.gflops == pytest.approx(2 * conv.macs / (conv.ms / 1000) / 1e9)
    assert conv.roofline_fraction == pytest.approx(conv.gflops / 100)


def test_a_layer_that_stands_for_several_counts_all_of_theirs():
    class Fused(nn.Module):
        def forward(self, x):
            return x

    original, x = small_network(), torch.randn(1, 3, 10, 12)
    fast = nn.Sequential(Fused(), nn.Identity(), nn.Identity())
    (layer,) = layers(over(fast, x), over(original, x), rate=1.0, repeats=1)
    assert layer.macs == 10 * 12 * 4 * 3 * 9


def test_hooks_do_not_stay():
    network = HapticNet(3, width=0.1).eval()
    x = torch.randn(1, 1, 50, 192)
    layers(over(network, x), over(network, x), rate=1.0, repeats=1)
    assert not any(module._forward_hooks for module in network.modules())
    assert not any(module._forward_pre_hooks for module in network.modules())


def test_the_rate_is_that_of_the_fastest_product():
    timings = {"10x20x30": Timing(2.0, 2.0, (2.0,)), "1000x1000x1000": Timing(10.0, 10.0, (10.0,))}
    assert gemm_gflops(timings) == pytest.approx(200.0)  # 2e9 operations in 10 ms
    functions = products(CPU)
    assert len(functions) == len(SHAPES)
    rows, _, columns = SHAPES[-1]
    assert functions["x".join(map(str, SHAPES[-1]))]().shape == (rows, columns)
