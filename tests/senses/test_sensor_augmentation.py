"""Augmented spectrograms, against noise and filters on the signals themselves."""

import numpy as np
import pytest
import torch
from scipy import signal

from tex_lightning.senses.features.spectrogram import SpectrogramFeatures
from tex_lightning.senses.sensor_augmentation import COSINES, SensorAugmentation, draw_changes

FRAMES, RATE = 300, 2_000.0


@pytest.fixture(scope="module")
def features():
    features = SpectrogramFeatures(sampling_rate=RATE, skip_impact=False)
    features.fit([features.magnitudes(stroke(seed)) for seed in range(4)])
    return features


def stroke(seed):
    """What rises towards low frequencies, (1, samples) of as many frames as a sub-sample."""
    samples = SpectrogramFeatures(sampling_rate=RATE).samples(FRAMES)
    white = np.random.default_rng(seed).standard_normal((1, samples))
    return torch.from_numpy(signal.lfilter([1], [1, -0.9], white)).float()


def changed(features, magnitudes, factor=0.0, first=0, response=(0.0,) * COSINES):
    drawn = torch.tensor([[factor, first, *response]])
    return SensorAugmentation(features, FRAMES, 1)(magnitudes[None], drawn)[0]


def test_magnitudes_come_back_from_the_input(features):
    magnitudes = features.magnitudes(stroke(5))
    torch.testing.assert_close(
        features.magnitudes_of(features.normalise(magnitudes)), magnitudes, rtol=1e-3, atol=1e-3
    )


def test_what_is_not_drawn_changes_nothing(features):
    magnitudes = features.magnitudes(stroke(5))
    assert torch.equal(changed(features, magnitudes), magnitudes)
    assert not draw_changes(0.0, FRAMES, 100, np.random.default_rng(0)).any()


@pytest.mark.parametrize("decibels", [10, 20, 40])
def test_noise_is_that_of_a_noisy_signal(features, decibels):
    """Band for band, the power is that which white noise adds to the signal."""
    clean = features.magnitudes(stroke(5))
    factor = 10 ** (-decibels / 20)
    white = torch.from_numpy(np.random.default_rng(9).standard_normal((1, stroke(5).shape[1])))
    unit = features.magnitudes(white.float()).mean()
    noisy = features.magnitudes(stroke(5) + (factor * clean.mean() / unit) * white.float())
    expected, found = (
        x.square().mean(dim=1).log() for x in (noisy, changed(features, clean, factor))
    )
    assert (expected - found).abs().mean() < 0.1  # of some nepers that it adds


def test_a_response_is_that_of_a_filter_and_has_the_level_of_none(features):
    """Each band has its own factor at all times, and their logarithms cancel."""
    magnitudes = features.magnitudes(stroke(5))
    gains = changed(features, magnitudes, response=(0.4, -0.3, 0.2, 0.1)) / magnitudes
    torch.testing.assert_close(gains, gains[:, :1].expand_as(gains))
    places = np.linspace(0, np.pi, features.bands)
    curves = (0.4 * np.cos(places), -0.3 * np.cos(2 * places), 0.2 * np.cos(3 * places))
    expected = np.exp(sum(curves) + 0.1 * np.cos(4 * places))
    np.testing.assert_allclose(gains[:, 0], expected, rtol=1e-4)
    assert abs(gains[:, 0].log().mean()) < 0.02


def test_the_share_gets_noise_and_the_share_a_response():
    drawn = draw_changes(0.3, FRAMES, 10_000, np.random.default_rng(0))
    noisy, other = drawn[:, 0] > 0, (drawn[:, 2:] != 0).all(dim=1)
    for each, share in ((noisy, 0.3), (other, 0.3), (noisy & other, 0.09)):
        assert abs(each.float().mean() - share) < 4 * (share * (1 - share) / 10_000) ** 0.5
    levels = -20 * drawn[noisy, 0].log10()
    assert 10 <= levels.min() < 11 < 49 < levels.max() <= 50
    assert drawn[:, 1].min() >= 0
    assert (
        drawn[:, 1].max() + FRAMES
        <= SensorAugmentation(SpectrogramFeatures(sampling_rate=RATE), FRAMES, 1).noise.shape[1]
    )
