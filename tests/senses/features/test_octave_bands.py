"""Bands of one window: their filters, and what they are compared with."""

import numpy as np
import pytest
import torch
from scipy.signal import ShortTimeFFT, detrend
from scipy.signal.windows import hann

from tex_lightning.senses.features.octave_bands import (
    FLOOR,
    OctaveBands,
    octave_filters,
    transform_length,
)


@pytest.mark.parametrize("rate", [1000.0, 2200.0, 10_000.0, 44_100.0])
@pytest.mark.parametrize("seconds", [0.032, 0.256])
def test_bands_are_means_over_channels_from_one_period_to_half_the_rate(rate, seconds):
    samples = round(seconds * rate)
    filters = octave_filters(rate, samples, 4).double()
    np.testing.assert_allclose(filters.sum(dim=1), 1, rtol=1e-6)
    assert (filters >= 0).all()
    assert filters[:, 0].max() == 0
    centres = filters @ (torch.arange(samples // 2 + 1, dtype=torch.float64) * rate / samples)
    assert (centres.diff() > 0).all()
    assert centres[0] < 2 * rate / samples
    assert rate / 2 / 2**0.5 < centres[-1] <= rate / 2


@pytest.mark.parametrize("trend", ["constant", "linear"])
def test_responses_compare_the_logarithms_of_scipys_spectrum(trend):
    length, hop = 128, 32
    bands = OctaveBands(2000.0, length, 4, thresholds=8, slow=False, apart=0)
    bands.detrends = trend == "linear"
    trace = torch.randn(1, 2000, generator=torch.Generator().manual_seed(0))
    trace += 20 * torch.sin(torch.arange(2000) / 300)  # most of it is trend
    transform = ShortTimeFFT(hann(length), hop, fs=2000.0)
    signal = trace[0].double().numpy()
    frames = np.lib.stride_tricks.sliding_window_view(signal, length)[::hop]
    frames = detrend(frames, type=trend)
    spectra = np.fft.rfft(frames * transform.win)
    power = np.abs(spectra) ** 2 @ octave_filters(2000.0, length, 4).double().numpy().T
    power /= transform.win.sum() ** 2
    logs = np.log(power + FLOOR * power.mean(axis=1, keepdims=True))
    earlier = logs[np.maximum(np.arange(len(logs)) - 4, 0)]  # one window
    mean = logs.mean(axis=1, keepdims=True)
    expected = [logs - mean, logs[:, 1:] - logs[:, :-1], logs - earlier]
    np.testing.assert_allclose(
        bands.responses(trace, torch.ones(())), np.concatenate(expected, axis=1), atol=2e-3
    )


@pytest.mark.parametrize("samples", [0.3, 17, 500.4, 1023, 1025, 7777, 65_536, 1e6])
def test_a_transform_is_the_next_of_small_factors_and_a_long_one_can_be_halved(samples):
    length = transform_length(samples)
    assert length >= 2
    assert samples - max(1, samples / 1024) <= length <= 1.1 * samples + 2
    odd = length
    while odd % 2 == 0 and odd > 1024:
        odd //= 2
    assert odd <= 1100
    for prime in (2, 3, 5, 7, 11):
        while odd % prime == 0:
            odd //= prime
    assert odd == 1
