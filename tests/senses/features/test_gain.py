"""Gains of a sensor that are told from the spectrum, as HapticNet's features use them."""

import pytest
import torch
from scipy.signal import resample

from tex_lightning.senses.features.gain import KnownGain
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures


def sounds(count, rate=2000):
    """Noise with a slope of its own each."""
    generator = torch.Generator().manual_seed(0)
    noises = torch.randn(count, 4 * rate, generator=generator)
    spectra = torch.fft.rfft(noises)
    slopes = torch.linspace(-1, 1, count)[:, None]
    spectra = spectra * torch.linspace(0.01, 1, spectra.shape[1]) ** slopes
    return list(torch.fft.irfft(spectra)[:, None])


def gains(features, trace):
    """The factor of each frame (frames,)."""
    magnitudes = features.magnitudes(trace).double()
    factors = features.known_gain(magnitudes) / magnitudes
    torch.testing.assert_close(factors, factors[:1].expand_as(factors), rtol=1e-4, atol=0)
    return factors[0].round(decimals=5).float()


@pytest.mark.parametrize("gain", [1e-4, 0.1, 0.5, 1.0, 30.0])
def test_a_training_recording_is_the_same_at_any_gain(gain):
    features = SpectrogramFeatures(sampling_rate=2000.0)
    traces = sounds(5)
    magnitudes = [features.magnitudes(trace) for trace in traces]
    features.fit(magnitudes)
    for trace, magnitude in zip(traces, magnitudes, strict=True):
        expected = features.normalise(magnitude)[None, None]
        torch.testing.assert_close(features(gain * trace), expected, rtol=0, atol=1e-3)
    loaded = SpectrogramFeatures(sampling_rate=2000.0)
    loaded.load_state_dict(features.state_dict())
    assert torch.equal(loaded(gain * traces[0]), features(gain * traces[0]))
    tone = torch.sin(torch.arange(8000) * 0.1)[None]
    assert all(features(other).isfinite().all() for other in (0 * tone, tone, 1 + 0 * tone))


def test_a_recording_of_another_shape_keeps_its_gain():
    features = SpectrogramFeatures(sampling_rate=2000.0)
    *trained, other = sounds(5)
    features.fit([features.magnitudes(trace) for trace in trained[:2]])
    assert torch.equal(gains(features, other).unique(), torch.ones(1))
    found = gains(features, 20 * trained[0])
    torch.testing.assert_close(found, torch.full_like(found, 0.05))


@pytest.mark.parametrize("seconds", [0.5, 2.0, 7.0])
def test_a_rest_before_does_not_hide_the_gain(seconds):
    features = SpectrogramFeatures(sampling_rate=2000.0, skip_impact=False)
    traces = sounds(5)
    features.fit([features.magnitudes(trace) for trace in traces])
    rest = 1e-3 * torch.randn(1, int(seconds * 2000), generator=torch.Generator().manual_seed(1))
    found = gains(features, torch.cat((rest, 8 * traces[1]), dim=1))
    moving = int(seconds * 100)
    assert found[moving:].numpy() == pytest.approx(1 / 8, rel=0.1)
    assert found[: moving - 15].unique().numel() == 1


@pytest.mark.parametrize(
    ("rate", "given", "used"),
    [(499.0, {}, False), (500.0, {}, True), (499.0, {"any_gain": True}, True),
     (44_100.0, {"any_gain": False}, False), (44_100.0, {"normalisation": "paper"}, False)],
)  # fmt: skip
def test_levels_of_slow_signals_tell_the_material(rate, given, used):
    features = SpectrogramFeatures(sampling_rate=rate, **given)
    trace = torch.randn(1, 4 * int(rate), generator=torch.Generator().manual_seed(0))
    features.fit([features.magnitudes(trace)])
    assert features.known_gain.in_use == used
    found = gains(features, 9 * trace)
    assert bool((found != 1).all()) == bool((found != 1).any()) == used


@pytest.mark.parametrize("gain", [1.0, 0.1])
@pytest.mark.parametrize("share", [0.3, 0.5, 0.9])
def test_what_was_recorded_at_a_lower_rate_has_the_bands_of_a_training_recording(share, gain):
    features = SpectrogramFeatures(sampling_rate=2000.0)
    traces = sounds(5)
    features.fit([features.magnitudes(trace) for trace in traces])
    few = resample(traces[1].numpy(), round(8000 * share), axis=1)
    back = torch.from_numpy(resample(few, 8000, axis=1)).float()
    expected, found = features(traces[1]), features(gain * back)
    heard = int((features.frequencies < 1000 * share).sum()) - 6
    torch.testing.assert_close(found[0, 0, :heard], expected[0, 0, :heard], rtol=0, atol=0.2)
    means = expected.mean(dim=-1)[0, 0], found.mean(dim=-1)[0, 0]
    assert (means[0] - means[1]).abs().max() < 1  # what is filled in is that of a louder frame
    features.known_gain.spectra = features.known_gain.spectra[:0]
    without = features(gain * back).mean(dim=-1)[0, 0]
    assert (means[0] - without).abs().max() > 3


@pytest.mark.parametrize(("quiet", "movement"), [(0.04, 60), (0.08, 100)])
def test_a_gain_is_told_from_what_30_percent_of_the_movement_exceed(quiet, movement):
    """Every third frame counts, and what has less than a twentieth of the magnitude is a rest."""
    every = 1 + torch.arange(100.0)[torch.randperm(100, generator=torch.Generator().manual_seed(0))]
    loud = torch.where(every > 40, 1 + every / 1000, quiet + every / 1e6)
    magnitudes = torch.zeros(2, 300)
    magnitudes[:, ::3] = torch.stack((loud, 2 * loud))
    heard = KnownGain(300, 2).heard(magnitudes)
    assert heard[1] == 2 * heard[0]
    assert int((loud > heard[0]).sum()) == pytest.approx(0.3 * movement, abs=1)
