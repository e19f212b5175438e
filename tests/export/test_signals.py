"""Features of signals as graphs, against those of the classifier."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import detrend, resample_poly

from tex_lightning.errors import UserError
from tex_lightning.export.signals import (
    BandPower,
    ProportionsGraph,
    SpectrogramGraph,
    signal_graph,
    traced_start,
)
from tex_lightning.senses.features.movement import movement_start
from tex_lightning.senses.features.proportions import BandProportions
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

RATE = 2_000.0


def recording(axes: int, seconds: float = 3.3) -> torch.Tensor:
    """Quiet, then steady movement."""
    trace = torch.randn(axes, int(seconds * RATE), generator=torch.Generator().manual_seed(axes))
    trace[:, : int(0.4 * RATE)] *= 1e-3
    return trace + 9.81


@pytest.mark.parametrize(
    ("axes", "options"),
    [
        (1, {"scale": "mel"}),
        (3, {"scale": "mel", "window_seconds": 0.03}),
        (3, {"scale": "linear"}),
        (1, {"scale": "linear", "normalisation": "paper"}),
        (1, {"scale": "mel", "skip_impact": False}),
    ],
)
def test_spectrogram(axes, options):
    features = SpectrogramFeatures(sampling_rate=RATE, **options)
    trace = recording(axes)
    features.fit([features.magnitudes(trace / 30), features.magnitudes(trace.sign() * 0.1)])
    found, found_start = SpectrogramGraph(features)(trace)
    torch.testing.assert_close(found, features(trace), rtol=0, atol=1e-3)
    half = resample_poly(resample_poly(trace.numpy(), 1, 2, axis=1), 2, 1, axis=1)
    half = torch.from_numpy(half[:, : trace.shape[1]])  # of half the rate
    torch.testing.assert_close(
        SpectrogramGraph(features)(half)[0], features(half), rtol=0, atol=1e-3
    )
    start = movement_start(trace, RATE) if features.skip_impact else 0
    assert int(found_start) == start


# a trend is taken out, and gravity tells the gain, unless all are positive
@pytest.mark.parametrize(("offset", "gain"), [(2, 1), (-12, 0.1)])
def test_proportions(offset, gain):
    features = BandProportions(
        sampling_rate=RATE, windows=[0.05, 5], bands_per_octave=[4, 6], thresholds=3,
        fragment_seconds=0.8, skip_impact=True, levels=3,
    )  # fmt: skip
    trace = recording(3)
    # of its own thresholds every value would be one
    features.learn([offset + recording(3).roll(37 + turn, dims=1) for turn in range(5)])
    assert bool(features.detrends) == features.gravity.in_use == (offset < 0)
    trace = gain * (offset + trace + torch.linspace(0, 5, trace.shape[1]))
    trace = trace[:, : int(2.9 * RATE)]
    found, expected = ProportionsGraph(features)(trace), features(trace)
    assert found.shape == expected.shape
    # a comparison may fall the other way by rounding: one frame of one band in one fragment
    assert ((found - expected).abs() > 1e-5).float().mean() < 0.01


@pytest.mark.parametrize(("length", "hop", "axes"), [(500, 100, 3), (60, 15, 1), (13, 4, 2)])
@pytest.mark.parametrize("detrends", [True, False])
def test_power_of_every_channel_is_that_of_a_fourier_transform(length, hop, axes, detrends):
    rng = np.random.default_rng(0)
    trace = rng.standard_normal((axes, 3 * length + 7)).cumsum(axis=1)
    window = np.hamming(length)
    filters = torch.from_numpy(rng.random((9, length // 2 + 1)))
    count = (trace.shape[1] - length) // hop + 1
    frames = np.stack([trace[:, hop * t : hop * t + length] for t in range(count)])
    frames = detrend(frames, type="linear" if detrends else "constant") * window
    power = (np.abs(np.fft.rfft(frames)) ** 2).sum(axis=1)
    slope = torch.linspace(-1, 1, length)
    slope = slope / slope.norm() if detrends else None
    module = BandPower(torch.from_numpy(window).float(), hop, filters, slope)
    found = module(torch.from_numpy(trace).float()).numpy()
    np.testing.assert_allclose(found, filters.numpy() @ power.T, rtol=1e-4)


SLOW_RATE = 1000.0


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
    assert int(traced_start(trace, SLOW_RATE)) == movement_start(trace, SLOW_RATE)


def test_features_that_join_the_axes_of_a_recording_are_refused():
    with pytest.raises(UserError, match="train with axes=frame"):
        signal_graph(SpectrogramFeatures(sampling_rate=RATE, axes="trace"))
