"""Power of bands by products of matrices, against NumPy's Fourier transform."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.export.fourier import BandPower, factors


@given(length=st.integers(2, 600))
def test_factors_multiply_to_the_length(length):
    outer, inner = factors(length)
    assert outer * inner == length


@pytest.mark.parametrize(("length", "hop", "axes"), [(500, 100, 3), (60, 15, 1), (13, 4, 2)])
@pytest.mark.parametrize("centred", [True, False])
def test_power_of_every_channel_is_that_of_a_fourier_transform(length, hop, axes, centred):
    rng = np.random.default_rng(0)
    trace = rng.standard_normal((axes, 3 * length + 7))
    window = np.hamming(length)
    filters = torch.from_numpy(rng.random((9, length // 2 + 1)))
    count = (trace.shape[1] - length) // hop + 1
    frames = np.stack([trace[:, hop * t : hop * t + length] for t in range(count)])
    frames = (frames - centred * frames.mean(axis=-1, keepdims=True)) * window
    power = (np.abs(np.fft.rfft(frames)) ** 2).sum(axis=1)
    module = BandPower(torch.from_numpy(window).float(), hop, filters, centred=centred)
    found = module(torch.from_numpy(trace).float()).numpy()
    np.testing.assert_allclose(found, filters.numpy() @ power.T, rtol=1e-4)
