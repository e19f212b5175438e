"""The shared pieces against closed forms and independent computations."""

import numpy as np
import pytest
import scipy.signal
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import (
    Head,
    Window,
    check_norm,
    conv_block,
    initialise,
    response_norm,
    scaled,
)


def test_scaled_rounds_and_keeps_at_least_one_channel():
    assert [scaled(50, width) for width in (2, 1, 0.5, 0.25, 0.001)] == [100, 50, 25, 12, 1]


@given(
    size=st.integers(1, 60),
    kernel=st.integers(1, 9),
    stride=st.integers(1, 4),
    padding=st.integers(0, 2),
)
def test_window_matches_convolution(size, kernel, stride, padding):
    expected = max(0, (size + 2 * padding - kernel) // stride + 1)
    assert Window(kernel, stride, padding).output(size) == expected
    if expected:
        conv = nn.Conv1d(1, 1, kernel, stride, padding)
        assert conv(torch.zeros(1, 1, size)).shape[-1] == expected


@pytest.mark.parametrize(("kernel", "stride"), [(2, 2), (3, 2)])
@pytest.mark.parametrize("ceil", [False, True])
def test_window_matches_its_pooling(kernel, stride, ceil):
    window = Window(kernel, stride, ceil=ceil)
    for size in range(kernel, 40):
        pooled = window.max_pool()(torch.zeros(1, 1, size, size))
        assert pooled.shape[-2:] == (window.output(size),) * 2


def test_window_of_nothing_is_nothing():
    assert Window(3, 1, padding=1).output(0) == 0


def test_check_norm_names_the_key_and_the_allowed_values():
    with pytest.raises(UserError, match=r"model\.visual\.norm=lrn .* batch, none\.$"):
        check_norm("lrn", ("batch", "none"), "model.visual.norm")


@pytest.mark.parametrize("norm", ["batch", "lrn", "none"])
def test_only_batch_normalised_convolutions_lack_a_bias(norm):
    block = conv_block(2, 4, 3, norm=norm)
    kinds = [type(layer) for layer in block]
    if norm == "batch":
        assert kinds == [nn.Conv2d, nn.BatchNorm2d, nn.ReLU]
        assert block[0].bias is None
    else:
        assert kinds == [nn.Conv2d, nn.ReLU]
        assert block[0].bias is not None


def test_grouped_convolution_matches_scipy():
    generator = torch.Generator().manual_seed(0)
    block = conv_block(4, 6, 5, norm="none", padding=2, groups=2).double()
    nn.init.normal_(block[0].bias, generator=generator)
    x = torch.randn(1, 4, 9, 8, dtype=torch.float64, generator=generator)
    weight, bias = block[0].weight.detach().numpy(), block[0].bias.detach().numpy()
    expected = np.zeros((6, 9, 8))
    for out in range(6):
        first = 0 if out < 3 else 2
        for inner in range(2):
            plane = x[0, first + inner].numpy()
            expected[out] += scipy.signal.correlate2d(plane, weight[out, inner], mode="same")
    expected = np.maximum(expected + bias[:, None, None], 0)
    np.testing.assert_allclose(block(x)[0].detach().numpy(), expected, atol=1e-12)


@pytest.mark.parametrize("channels", [1, 3, 12])
def test_response_norm_matches_caffes_formula(channels):
    (layer,) = response_norm("lrn")
    x = 100 * np.random.default_rng(0).standard_normal((2, channels, 3, 4))
    expected = np.empty_like(x)
    for c in range(channels):
        around = x[:, max(0, c - 2) : c + 3]
        expected[:, c] = x[:, c] / (1 + 1e-4 / 5 * (around**2).sum(axis=1)) ** 0.75
    np.testing.assert_allclose(layer(torch.from_numpy(x)).numpy(), expected, rtol=1e-12)


@pytest.mark.parametrize("norm", ["batch", "none"])
def test_other_norms_have_no_response_norm(norm):
    assert response_norm(norm) == []


def test_initialise_keeps_the_variance_through_relu_layers():
    torch.manual_seed(0)
    layers = nn.Sequential(*(conv_block(256, 256, 1, norm="none") for _ in range(6)))
    initialise(layers)
    x = torch.randn(64, 256, 1, 1)
    assert 0.3 < layers(x).square().mean() / x.square().mean() < 3
    assert all(not block[0].bias.any() for block in layers)


def test_head_starts_near_uniform_and_drops_only_in_training():
    torch.manual_seed(0)
    hidden = nn.Sequential(conv_block(8, 64, 1, norm="none"))
    head = Head(hidden, 64, classes=5, dropout=0.5)
    x = torch.randn(4, 8, 1, 3)
    scores = head.eval()(x)
    assert scores.shape == (4, 5, 1, 3)
    assert scores.softmax(1).sub(1 / 5).abs().max() < 0.1
    assert torch.equal(scores, head(x))
    assert not torch.equal(scores, head.train()(x))
    assert torch.equal(head(x, "fc2"), hidden(x))
