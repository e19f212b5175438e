"""The start of movement as a graph, against the one that branches on lengths."""

import torch
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.export.movement import traced_start
from tex_lightning.features.spectrogram import movement_start

RATE = 1000.0


@given(
    samples=st.integers(1, 4000),
    touch=st.integers(0, 2500),
    quiet=st.sampled_from([1e-4, 1e-2, 0.5]),
    axes=st.sampled_from([1, 3]),
    seed=st.integers(0, 99),
)
def test_the_start_is_the_same(samples, touch, quiet, axes, seed):
    generator = torch.Generator().manual_seed(seed)
    trace = torch.randn(axes, samples, generator=generator) + 9.81
    trace[:, :touch] = 9.81 + quiet * torch.randn(axes, samples, generator=generator)[:, :touch]
    assert int(traced_start(trace, RATE)) == movement_start(trace, RATE)
