"""Every streaming layer against PyTorch's own on all of the input so far."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from tex_lightning.inference.engine import FastResponseNorm
from tex_lightning.inference.stream_layers import StreamingLayer, streaming_layers


def pushed(layers: list[StreamingLayer], columns, settled):
    for layer in layers:
        columns, settled = layer.push(columns, settled)
    return columns, settled


@torch.no_grad()
def assert_follows(network: nn.Module, bands: int, sizes: list[tuple[int, int]], restart: bool):
    """After every push, settled and open outputs are the network's of all input so far."""
    generator = torch.Generator().manual_seed(len(sizes))
    layers = streaming_layers([network.eval()])
    total = sum(settled for settled, _ in sizes) + sizes[-1][1]
    x = torch.randn(1, 2, bands, total, generator=generator)
    if restart:
        pushed(layers, x[0].permute(2, 1, 0)[:7], 5)
        for layer in layers:
            layer.restart()
    done, known = 0, []
    for settled, rest in sizes:
        if settled + rest == 0:
            continue
        seen = x[..., : done + settled + rest]
        columns, fixed = pushed(layers, seen[0, ..., done:].permute(2, 1, 0), settled)
        done += settled
        try:
            expected = network(seen)
        except RuntimeError:  # fewer columns than the kernel has
            assert columns is None
            continue
        found = torch.cat([*known, columns]).permute(2, 1, 0)[None]
        torch.testing.assert_close(found, expected, atol=1e-4, rtol=1e-4)
        known.append(columns[:fixed])


def lively(network: nn.Module) -> nn.Module:
    """With running statistics that are not those of new layers."""
    for layer in network.modules():
        if isinstance(layer, nn.BatchNorm2d):
            nn.init.normal_(layer.running_mean)
            nn.init.uniform_(layer.running_var, 0.5, 2.0)
    return network


def networks() -> dict[str, tuple[nn.Module, int]]:
    torch.manual_seed(0)
    pool = nn.MaxPool2d(2, 2, ceil_mode=True)
    return {
        "padded": (nn.Conv2d(2, 3, 3, padding=1), 7),
        "unpadded": (nn.Conv2d(2, 3, (4, 12), bias=False), 4),
        "few inputs": (nn.Conv2d(2, 7, 3, padding=1), 5),
        "few inputs, unpadded": (nn.Conv2d(2, 9, (4, 5), bias=False), 6),
        "single": (nn.Conv2d(2, 3, 1), 5),
        "pool": (pool, 5),
        "norms": (lively(nn.Sequential(nn.BatchNorm2d(2), nn.LocalResponseNorm(2), nn.ReLU())), 3),
        "engine": (nn.Sequential(FastResponseNorm(nn.LocalResponseNorm(5, 3.0)), nn.Identity()), 3),
        "stack": (
            lively(
                nn.Sequential(
                    nn.Sequential(nn.Conv2d(2, 4, 3, padding=1), pool, nn.BatchNorm2d(4)),
                    nn.Conv2d(4, 3, 3, padding=1, bias=False),
                    pool,
                    nn.ReLU(),
                    nn.Dropout(),
                    nn.Conv2d(3, 5, (2, 3)),
                    nn.Identity(),
                    nn.Conv2d(5, 2, 1),
                )
            ),
            8,
        ),
    }


NETWORKS = networks()


@pytest.mark.parametrize("name", NETWORKS)
@given(
    sizes=st.lists(st.tuples(st.integers(0, 15), st.integers(0, 4)), min_size=1, max_size=8),
    restart=st.booleans(),
)
def test_pushes_give_what_the_layer_gives_at_once(name, sizes, restart):
    network, bands = NETWORKS[name]
    if name == "stack":  # its first column is nobody's edge
        sizes = [(settled, 0) for settled, _ in sizes]
    assert_follows(network, bands, sizes, restart)


@pytest.mark.parametrize(
    "layer",
    [
        nn.Conv2d(2, 2, 3, stride=2),
        nn.Conv2d(2, 2, 3, dilation=2),
        nn.Conv2d(2, 2, 3, groups=2),
        nn.MaxPool2d(3, 2),
        nn.MaxPool2d(2, 2),
    ],
)
def test_other_layers_are_refused(layer):
    with pytest.raises(ValueError, match=r"Conv2d|MaxPool2d"):
        streaming_layers([layer])
