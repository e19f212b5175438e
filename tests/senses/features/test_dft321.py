import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.senses.features.dft321 import dft321, quick_length


def reference(axes: np.ndarray) -> np.ndarray:
    """The two-sided transform with both halves written out, in NumPy."""
    spectrum = np.fft.fft(axes - axes.mean(axis=1, keepdims=True), axis=1)
    magnitude = np.sqrt((np.abs(spectrum) ** 2).sum(axis=0))
    phase = np.angle(spectrum.sum(axis=0))
    return np.fft.ifft(magnitude * np.exp(1j * phase)).real


@given(samples=st.integers(8, 400), seed=st.integers(0, 1000))
def test_equals_the_two_sided_transform(samples, seed):
    axes = np.random.default_rng(seed).standard_normal((3, samples))
    result = dft321(torch.from_numpy(axes)).numpy()
    np.testing.assert_allclose(result, reference(axes), atol=1e-9)


@pytest.mark.parametrize("samples", [1000, 1001])
def test_keeps_the_energy(samples):
    axes = np.random.default_rng(0).standard_normal((3, samples))
    axes += np.array([[9.81], [0.0], [1.0]])
    energy = ((axes - axes.mean(axis=1, keepdims=True)) ** 2).sum()
    assert dft321(torch.from_numpy(axes)).square().sum().item() == pytest.approx(energy)


def test_axes_that_cancel_and_silence_are_finite():
    wave = torch.sin(torch.arange(500) * 0.1)
    cancelled = dft321(torch.stack((wave, -wave, torch.zeros(500))))
    assert torch.isfinite(cancelled).all()
    assert torch.equal(dft321(torch.zeros(3, 500)), torch.zeros(500))


@given(samples=st.integers(500, 1_000_000))
def test_hardly_anything_is_left_out_and_no_factor_is_large(samples):
    left = quick = quick_length(samples)
    assert 0.975 * samples <= quick <= samples
    for factor in (2, 3, 5, 7, 11):
        while left % factor == 0:
            left //= factor
    assert left == 1
