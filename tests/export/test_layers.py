"""Layers that can be traced, against PyTorch's own."""

import pytest
import torch
from conftest import make_card
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.export.graph import BandedResponseNorm, CeilMaxPool, exportable


@given(kernel=st.integers(1, 5), stride=st.integers(1, 5), size=st.integers(5, 24))
def test_pooling_with_a_margin_rounds_up_as_pytorch_does(kernel, stride, size):
    pool = nn.MaxPool2d(kernel, stride, ceil_mode=True)
    assert CeilMaxPool.fits(pool) == (stride <= kernel)
    if stride <= kernel:
        maps = torch.randn(1, 2, size, size + 3)
        torch.testing.assert_close(CeilMaxPool(pool)(maps), pool(maps), rtol=0, atol=0)


def test_a_network_is_copied_and_says_the_same():
    (sense,) = SurfaceClassifier(make_card("haptic", width=0.1, norm="lrn")).eval().senses.values()
    network = sense.network
    before = {name: each.clone() for name, each in network.state_dict().items()}
    spectrogram = torch.randn(1, 1, 50, 301)
    torch.testing.assert_close(exportable(sense, ["fc3"])(spectrogram), network(spectrogram))
    assert any(isinstance(each, nn.LocalResponseNorm) for each in network.modules())
    assert all(torch.equal(each, before[name]) for name, each in network.state_dict().items())


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 6])
def test_response_norm_by_a_band_of_any_size(size):
    layer = nn.LocalResponseNorm(size, alpha=0.5, beta=0.6, k=2)
    for maps in (torch.randn(2, 7, 3, 4), torch.randn(2, 7, 5)):
        torch.testing.assert_close(BandedResponseNorm(layer)(maps), layer(maps))
