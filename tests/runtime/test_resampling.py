"""Signals come to another rate as by SciPy, to the last bit, and keep their level; spikes go."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import signal

from tex_lightning_runtime.errors import UserError
from tex_lightning_runtime.resampling import (
    find_spikes,
    low_pass,
    rate_ratio,
    resample_poly,
    to_rate,
    without_spikes,
)

RATES = st.sampled_from([1_000, 2_200, 8_000, 9_973.1, 10_000, 20_000, 44_100, 48_000])


def by_scipy(x, up, down):
    window = low_pass(up, down).astype(x.dtype)
    return signal.resample_poly(x, up, down, axis=1, window=window, padtype="edge")


def noise(axes, count, dtype):
    return np.random.default_rng(count).standard_normal((axes, count)).astype(dtype)


@given(RATES, RATES, st.integers(1, 900), st.sampled_from(["f4", "f8"]), st.sampled_from([1, 3]))
def test_resamples_as_scipy_does(source, target, count, dtype, axes):
    up, down = rate_ratio(source, target, "it").as_integer_ratio()
    assume(up != down)
    x = noise(axes, count, dtype)
    expected = by_scipy(x, up, down)
    found = resample_poly(x, up, down)
    assert found.dtype == expected.dtype
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("source", [1_000.0, 9_000.0, 44_100.0, 48_000.0])
@pytest.mark.parametrize("dtype", ["f4", "f8"])
@pytest.mark.parametrize("together", [1, 1 << 17])
def test_a_long_signal_has_the_bits_that_scipy_gives(monkeypatch, source, dtype, together):
    monkeypatch.setattr("tex_lightning_runtime.resampling.IN_CACHE", together)
    x = noise(3, 90_000, dtype)
    up, down = rate_ratio(source, 10_000, "it").as_integer_ratio()
    expected = by_scipy(x, up, down).astype(np.float32)
    np.testing.assert_array_equal(resample_poly(x, up, down).astype(np.float32), expected)


@pytest.mark.parametrize("source", [100.0, 1_000.0, 9_000.0, 44_100.0])
def test_the_filter_is_scipys_and_keeps_a_level(source):
    up, down = rate_ratio(source, 10_000, "it").as_integer_ratio()
    own = signal.firwin(20 * max(up, down) + 1, 1 / max(up, down), window=("kaiser", 5.0))
    assert np.abs(up * low_pass(up, down) - up * own).max() < 2e-3
    level = np.array([[9.81], [-32_768.0], [0.0]], np.float32).repeat(300, axis=1)
    found = to_rate(level, source, 10_000, "it")
    np.testing.assert_allclose(found, level[:, :1].repeat(found.shape[1], axis=1), rtol=1e-6)


@pytest.mark.parametrize(("source", "resampled"), [(35.606, False), (35.868, True), (71.2, True)])
def test_samples_of_nearly_the_same_rate_stay_as_they_are(source, resampled):
    trace = noise(1, 200, "f4")
    assert (to_rate(trace, source, 35.624, "it").tobytes() != trace.tobytes()) == resampled


def test_rates_of_no_signal_and_too_many_samples_are_refused(monkeypatch):
    for rate in (0.0, -1.0, 18.9, 2.2e5, np.nan):
        with pytest.raises(UserError, match=r"^It has a sampling rate of .* \(data.file_rate whe"):
            to_rate(noise(1, 9, "f4"), rate, 10_000, "It")
    with pytest.raises(UserError, match=r"rates are 20 Hz to 200 kHz; correct it \(somehow\)\.$"):
        rate_ratio(5, 10_000, "It", "somehow")
    monkeypatch.setattr("tex_lightning_runtime.resampling.MAX_SAMPLES", 7_999)
    with pytest.raises(UserError, match="would become 8000 samples at 10000 Hz; correct that rate"):
        to_rate(noise(1, 2_000, "f4"), 2_500, 10_000, "It")


WAVES = {  # that are measured: nothing in them is a spike
    "noise": noise(1, 20_000, "f8"),
    "impulses that ring": np.convolve(
        noise(1, 9_000, "f8")[0] ** 9, np.exp(-np.arange(60) / 8) * np.cos(np.arange(60))
    )[None],
    "steps": np.repeat(noise(1, 90, "f8"), 100, axis=1),
    "ticks of a coarse converter": (noise(1, 9_000, "f8") > 2.5).astype(float),
    "a chirp up to half the rate": signal.chirp(np.arange(9_000), 0, 9_000, 0.5)[None],
    "a few samples": np.array([[0.0, 1.0] * 7 + [99.0]]),
}


@pytest.mark.parametrize("name", WAVES)
def test_what_is_measured_stays_as_it_is(name):
    assert not len(find_spikes(WAVES[name]))


@pytest.mark.parametrize("length", [1, 2])
@pytest.mark.parametrize("height", [25.0, -25.0])
@pytest.mark.parametrize("together", [50, 1 << 17])
def test_spikes_go_and_nothing_else_changes(monkeypatch, length, height, together):
    monkeypatch.setattr("tex_lightning_runtime.resampling.IN_CACHE", together)
    clean = 400 + 10 * signal.sosfilt(signal.butter(4, 0.3, output="sos"), noise(3, 3_000, "f8"))
    places = np.arange(20, 2_900, 137)[:, None] + np.arange(length)
    spoilt = clean.copy()
    spoilt[1, places] += 10 * height
    found = without_spikes(spoilt, 50, find_spikes(spoilt))
    changed = found != spoilt
    assert set(np.flatnonzero(changed[1])) == set(places.flat)
    assert not changed[[0, 2]].any()
    assert np.abs(found - clean).max() < 4 * clean.std()  # of a step of ten times that
    np.testing.assert_array_equal(to_rate(spoilt, 50, 50, "it"), found.astype(np.float32))


@pytest.mark.parametrize("together", [50, 1 << 17])
def test_five_spikes_in_four_seconds_go_and_what_recurs_stays(monkeypatch, together):
    monkeypatch.setattr("tex_lightning_runtime.resampling.IN_CACHE", together)
    places = [*range(100, 1_300, 60), 2_000]  # of impacts at 100 Hz
    impacts = 0.01 * noise(2, 2_100, "f8")
    impacts[1, places] += 1
    found = without_spikes(impacts, 100, find_spikes(impacts))
    assert np.flatnonzero((found != impacts)[1]).tolist() == [*places[:5], places[-1]]
    assert not (found != impacts)[0].any()
