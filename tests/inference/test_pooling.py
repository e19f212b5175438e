"""Pooling by maxima of rows and columns against PyTorch's."""

import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.nn.functional import max_pool2d

from tex_lightning.inference.pooling import FastPool


@given(st.tuples(*[st.integers(1, limit) for limit in (3, 5, 9, 9)]), st.booleans())
def test_it_equals_pytorchs_for_every_shape_and_layout(shape, last):
    x = torch.randn(shape, generator=torch.Generator().manual_seed(sum(shape)))
    if last:
        x = x.contiguous(memory_format=torch.channels_last)
    before = x.clone()
    assert torch.equal(FastPool()(x), max_pool2d(x, 2, 2, ceil_mode=True))
    assert torch.equal(x, before)
