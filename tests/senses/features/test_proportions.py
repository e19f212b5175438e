"""Proportions of bands: filters, what counts and what does not, fragments, wrong input."""

import numpy as np
import pytest
import torch
from scipy.signal import ShortTimeFFT
from scipy.signal.windows import hann

from tex_lightning.errors import UserError
from tex_lightning.senses.features.proportions import FLOOR, BandProportions, octave_filters

WINDOWS = (0.032, 0.256)


def make(rate: float = 2000.0, **changes) -> BandProportions:
    settings = {
        "windows": WINDOWS,
        "bands_per_octave": 4,
        "thresholds": 8,
        "fragment_seconds": 0.5,
        "skip_impact": False,
    }
    return BandProportions(sampling_rate=rate, **{**settings, **changes})


def noise(seconds: float, rate: float = 2000.0, seed: int = 0, axes: int = 1) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(axes, round(seconds * rate), generator=generator)


@pytest.mark.parametrize("rate", [1000.0, 2200.0, 10_000.0, 44_100.0])
@pytest.mark.parametrize("seconds", WINDOWS)
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


def test_responses_are_logarithms_of_scipys_spectrum_against_mean_and_band_below():
    features = make(windows=(0.064,))
    trace = noise(1.0)
    (ours,) = features.responses(trace)
    length, hop = 128, 32
    transform = ShortTimeFFT(hann(length), hop, fs=2000.0)
    signal = trace[0].double().numpy()
    frames = np.lib.stride_tricks.sliding_window_view(signal, length)[::hop]
    spectra = np.stack([np.fft.rfft((each - each.mean()) * transform.win) for each in frames])
    power = np.abs(spectra) ** 2 @ octave_filters(2000.0, length, 4).double().numpy().T
    bands = np.log(power / transform.win.sum() ** 2 + FLOOR).T
    expected = np.concatenate([bands - bands.mean(axis=0), bands[1:] - bands[:-1]])
    np.testing.assert_allclose(ours, expected, atol=2e-3)


def test_half_of_the_frames_stand_above_the_middle_of_an_even_number_of_thresholds():
    features, traces = make(), [noise(4, seed=seed) for seed in range(6)]
    features.learn(traces)
    found = torch.cat([features(trace)[0, 0] for trace in traces], dim=1)
    shares = found.reshape(-1, 8, found.shape[1]).mean(dim=(0, 2))
    torch.testing.assert_close(shares, 1 - (torch.arange(8) + 0.5) / 8, atol=0.03, rtol=0)


def test_neither_strength_nor_offset_nor_polarity_counts():
    features = make()
    features.learn([noise(4), noise(4, seed=1)])
    trace = noise(3, seed=2)
    for other in (5 * trace, trace + 9.81, -trace):
        assert (features(other) - features(trace)).abs().mean() < 1e-3


def test_three_axes_count_by_their_power_whichever_way_the_tool_is_turned():
    features, trace = make(), noise(3, axes=3)
    features.learn([trace])
    turn, _ = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(1)))
    assert (features(turn @ trace) - features(trace)).abs().mean() < 1e-2
    assert (features(trace.flip(-1)) - features(trace)).abs().mean() > 2e-2


@pytest.mark.parametrize(("seconds", "fragments"), [(0.26, 1), (1.2, 2), (5.0, 10)])
def test_fragments_are_about_half_seconds(seconds, fragments):
    features = make()
    features.learn([noise(5)])
    trace = noise(seconds, seed=3)
    found = features(trace)
    assert found.shape == (1, 1, features.bands, fragments)
    assert 0 <= found.min() <= found.max() <= 1 + 1e-6


def test_rows_of_a_fragment_are_the_frames_inside_of_it():
    features = make()
    quiet, loud = noise(2), torch.sin(2 * torch.pi * 300 * torch.arange(4000) / 2000)[None]
    features.learn([quiet, loud])
    both = features(torch.cat((quiet, loud), dim=1))[0, 0]
    alone = features(quiet)[0, 0]
    torch.testing.assert_close(both[:, :3], alone[:, :3], atol=0.35, rtol=0)
    assert (both[:, 0] - both[:, -1]).abs().max() == 1


def test_what_is_too_short_is_refused_with_its_length():
    features = make()
    with pytest.raises(UserError, match=r"0\.20 s of movement, less than one window of 0\.256 s"):
        features(noise(0.2))
    with pytest.raises(UserError, match="choose longer features"):
        make(windows=(0.001,))
