"""Local response normalisation against PyTorch's."""

import torch
from hypothesis import given
from hypothesis import strategies as st

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
