"""The shared pieces against closed forms and independent computations."""

import re

import numpy as np
import pytest
import torch
from torch import nn

from tex_lightning.networks.blocks import FittedLater, Head, Window, conv_block, response_norm


@pytest.mark.parametrize(("kernel", "stride"), [(2, 2), (3, 2)])
@pytest.mark.parametrize("ceil", [False, True])
def test_window_matches_its_pooling(kernel, stride, ceil):
    window = Window(kernel, stride, ceil=ceil)
    for size in range(kernel, 40):
        pooled = window.max_pool()(torch.zeros(1, 1, size, size))
        assert pooled.shape[-2:] == (window.output(size),) * 2


@pytest.mark.parametrize("channels", [1, 3, 12])
def test_response_norm_matches_caffes_formula(channels):
    (layer,) = response_norm("lrn")
    x = 100 * np.random.default_rng(0).standard_normal((2, channels, 3, 4))
    expected = np.empty_like(x)
    for c in range(channels):
        around = x[:, max(0, c - 2) : c + 3]
        expected[:, c] = x[:, c] / (1 + 1e-4 / 5 * (around**2).sum(axis=1)) ** 0.75
    np.testing.assert_allclose(layer(torch.from_numpy(x)).numpy(), expected, rtol=1e-12)


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


@pytest.mark.parametrize(
    ("line", "places", "told"),
    [
        (torch.ones(4, 3), torch.ones(3), None),
        (torch.zeros(0), torch.zeros(0), None),
        (torch.ones(5, 3), torch.ones(3), "line has the shape [5, 3], not [4, 'd']"),
        (torch.ones(4, 3), torch.ones(2), "places has the shape [2], not ['d']"),
        (torch.ones(4, 3), torch.ones(()), "places has the shape [], not ['d']"),
        (torch.ones(()), torch.ones(3), "line has the shape [], not [4, 'd']"),
        (torch.zeros(0), torch.ones(3), "places has the shape [3], not [0]"),
        (torch.ones(4, 3), torch.zeros(0), "places has the shape [0], not ['d']"),
    ],
)
def test_what_is_fitted_later_takes_its_sizes_from_a_state_but_no_others(line, places, told):
    part = FittedLater(line=(4, "d"), places=("d",))
    if told is None:
        part.load_state_dict({"line": line, "places": places})
        assert part.in_use == bool(line.numel())
        torch.testing.assert_close(part.get_buffer("places"), places)
    else:
        with pytest.raises(RuntimeError, match=re.escape(told)):
            part.load_state_dict({"line": line, "places": places})
