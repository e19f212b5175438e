"""What sensors, clocks and hands differ by, against what each is said to do."""

import numpy as np
import pytest
from scipy.signal import periodogram

from tex_lightning.perturbations import traces
from tex_lightning.perturbations.pixels import Scene

RATE = 2000.0


def scene(seed: int = 0, rate: float = RATE) -> Scene:
    return Scene(np.random.default_rng(seed), rate)


def noise(samples: int = 8000, axes: int = 2) -> np.ndarray:
    drawn = np.random.default_rng(3).standard_normal((axes, samples))
    return (5 + np.arange(1, axes + 1)[:, None] * drawn).astype(np.float32)


@pytest.mark.parametrize("rate", [5.0, 36.0, 100.0, RATE, 44_100.0])
@pytest.mark.parametrize("samples", [1, 2, 3, 50, 8000])
@pytest.mark.parametrize("kind", range(len(traces.DISTURBANCES)))
def test_every_recording_stays_one(kind, samples, rate):
    for trace in (noise(samples), np.zeros((1, samples), np.float32)):
        before = trace.copy()
        changed = traces.disturbed(trace, kind, scene(kind, rate))
        assert changed.dtype == np.float32
        assert changed.flags["C_CONTIGUOUS"]
        assert len(changed) == len(trace)
        assert abs(changed.shape[1] - samples) <= 1 + 0.13 * samples
        assert np.isfinite(changed).all()
        np.testing.assert_array_equal(trace, before)


def test_they_follow_their_seed_and_are_counted_on():
    kinds = len(traces.DISTURBANCES)
    first, again = (traces.disturbed(noise(), kind, scene(5)) for kind in (1, 1 + kinds))
    np.testing.assert_array_equal(first, again)
    changed = [traces.disturbed(noise(), kind, scene(5)) for kind in range(kinds)]
    assert len({each.tobytes() for each in changed}) == kinds


def test_a_response_amplifies_octaves_and_keeps_the_mean():
    trace = noise(axes=1)
    changed = [traces.frequency_response(trace, 6, scene(seed)) for seed in range(40)]
    spectra = [np.abs(np.fft.rfft(each, axis=1)[0]) for each in (trace, *changed)]
    decibels = 20 * np.log10(np.stack(spectra[1:]) / spectra[0])
    np.testing.assert_allclose(decibels[:, 0], 0, atol=1e-4)
    at_octaves = decibels[:, [2, 8, 64, 512, 2048]]
    assert 4.5 < at_octaves.std() < 7.5
    between = decibels[:, 724]  # half an octave above the 512nd channel
    np.testing.assert_allclose(between, (decibels[:, 512] + decibels[:, 1024]) / 2, atol=0.1)


def test_a_hum_has_its_strength_and_at_most_six_lines():
    trace = noise(axes=1)
    hum = traces.hum_with_harmonics(trace, 15, scene(2)) - trace
    assert 10 * np.log10(trace.var() / hum.var()) == pytest.approx(15, abs=0.3)
    frequencies, spectrum = periodogram(hum[0], RATE, window="hann")
    tone = frequencies[:280][spectrum[:280].argmax()]  # below 70 Hz
    lines = np.abs(frequencies / tone - np.round(frequencies / tone)) < 0.02
    assert 39 < tone < 71
    assert spectrum[lines & (frequencies < 6.5 * tone)].sum() > 0.99 * spectrum.sum()


def test_a_hum_has_no_line_beyond_half_the_rate():
    trace = noise(axes=1)
    assert traces.hum_with_harmonics(trace, 15, scene(2, 80.0)) is trace
    slow = traces.hum_with_harmonics(trace, 15, scene(2, 100.0)) - trace
    frequencies, spectrum = periodogram(slow[0], 100.0, window="hann")
    near = np.abs(frequencies - frequencies[spectrum.argmax()]) < 0.2
    assert 39 < frequencies[spectrum.argmax()] < 50
    assert spectrum[near].sum() > 0.99 * spectrum.sum()
