"""Local response normalisation against PyTorch's."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from tex_lightning.inference import engine as response_norm
from tex_lightning.inference.engine import FastResponseNorm
from tex_lightning.networks.blocks import response_norm as published

(LAYER,) = published("lrn")


@given(
    st.integers(1, 20),
    st.tuples(st.integers(1, 3), st.integers(1, 7), st.integers(1, 7)),
    st.floats(0.01, 300),
    st.booleans(),
    st.sampled_from([1, 37, 1 << 19]),
)
def test_it_equals_pytorchs_for_every_shape_layout_and_piece(channels, size, scale, last, piece):
    batch, height, width = size
    generator = torch.Generator().manual_seed(channels)
    x = scale * torch.randn(batch, channels, height, width, generator=generator)
    if last:
        x = x.contiguous(memory_format=torch.channels_last)
    expected = LAYER(x)
    before, response_norm.PIECE = response_norm.PIECE, piece
    try:
        found = FastResponseNorm(LAYER)(x)
    finally:
        response_norm.PIECE = before
    torch.testing.assert_close(found, expected, rtol=2e-6, atol=0)


def test_bfloat16_is_rounded_at_the_end():
    x = 100 * torch.randn(1, 96, 4, 4, generator=torch.Generator().manual_seed(0)).bfloat16()
    expected = LAYER(x.float()).bfloat16()
    torch.testing.assert_close(FastResponseNorm(LAYER)(x), expected, rtol=2**-7, atol=0)


def test_other_layers_are_not_mistaken_for_alexnets():
    with pytest.raises(ValueError, match="not those of AlexNet"):
        FastResponseNorm(nn.LocalResponseNorm(3))
