"""Cepstral coefficients, mixtures and naive Bayes against their definitions written out."""

import numpy as np
import pytest
import torch
from conftest import make_trace
from scipy.fft import dct
from scipy.signal import get_window
from scipy.stats import norm

from tex_lightning.baselines.mfcc import Cepstra, filter_edges
from tex_lightning.errors import UserError

RATE = 10_000


def make_cepstra(**changes):
    given = {
        "window_seconds": 0.025, "hop_seconds": 0.015, "highest_hz": 1400.0, "filters": 20,
        "spacing": "mel", "first": 2, "last": 14,
    }  # fmt: skip
    return Cepstra(**{**given, **changes})


def test_coefficients_are_a_cosine_transform_of_log_powers_in_mel_bands():
    trace = np.random.default_rng(0).standard_normal(3000)
    frames = np.lib.stride_tricks.sliding_window_view(trace, 250)[::150]
    powers = np.abs(np.fft.rfft(frames * get_window("hamming", 250), 1000)) ** 2
    corners = 700 * (10 ** (np.linspace(0, 2595 * np.log10(1 + 1400 / 700), 22) / 2595) - 1)
    hertz = np.arange(501) * 10.0
    bands = [np.interp(hertz, corners[band : band + 3], [0, 1, 0]) for band in range(20)]
    expected = dct(np.log(powers @ np.transpose(bands)), norm="ortho")[:, :14]
    ours = make_cepstra(first=1).coefficients(trace, RATE)
    np.testing.assert_allclose(ours, expected, atol=1e-4)


def test_level_moves_the_first_coefficient_only():
    trace = np.random.default_rng(1).standard_normal(2000)
    cepstra = make_cepstra(first=1)
    quiet, loud = cepstra.coefficients(trace, RATE), cepstra.coefficients(3 * trace, RATE)
    np.testing.assert_allclose(loud[:, 1:], quiet[:, 1:], atol=1e-9)
    np.testing.assert_allclose(loud[:, 0] - quiet[:, 0], np.sqrt(20) * np.log(9))


def test_decreasing_filters_are_the_mel_filters_mirrored():
    mel, decreasing = (filter_edges(20, 1400.0, name) for name in ("mel", "decreasing"))
    assert mel[0] == decreasing[0] == pytest.approx(0)
    assert mel[-1] == pytest.approx(decreasing[-1]) == pytest.approx(1400)
    assert (np.diff(mel, 2) > 0).all()
    assert (np.diff(decreasing, 2) < 0).all()
    np.testing.assert_allclose(np.diff(decreasing), np.diff(mel)[::-1])


@pytest.mark.parametrize("changes", [{"first": 0}, {"last": 21}, {"hop_seconds": 0.001}])
def test_what_has_no_coefficients_or_takes_too_much_memory_is_refused(changes):
    with pytest.raises(UserError, match="window_seconds up to 20 times hop_seconds"):
        make_cepstra(**changes)


@pytest.mark.parametrize("spacing", ["mel", "decreasing"])
def test_the_filters_end_at_half_of_a_low_rate_and_that_is_said_once(caplog, monkeypatch, spacing):
    monkeypatch.setattr("tex_lightning.core.console.Screen.logged", set())
    trace = np.random.default_rng(2).standard_normal(4400)
    with caplog.at_level("INFO", "tex_lightning"):
        found = [make_cepstra(spacing=spacing).coefficients(trace, 2200) for _ in range(2)]
    expected = make_cepstra(spacing=spacing, highest_hz=1100.0).coefficients(trace, 2200)
    np.testing.assert_array_equal(found, [expected] * 2)
    assert caplog.messages == [
        "The filters end at 1100 Hz, half the sampling rate, in place of "
        "model.baseline.highest_hz=1400."
    ]


@pytest.mark.parametrize("rate", [20, 36, 100, 2799, 2800])
@pytest.mark.parametrize("name", ["mfcc_gmm", "mfcc_nb"])
def test_slow_sensors_are_classified(configured, rate, name):
    rng = np.random.default_rng(0)
    traces = [scale * rng.standard_normal(8 * rate) for scale in (1, 2, 1, 2)]
    traces = [np.cumsum(trace) if place < 2 else trace for place, trace in enumerate(traces)]
    baseline = configured(name)
    baseline.sampling_rate = rate
    baseline.fit(traces, np.array([0, 0, 1, 1]), seed=0)
    assert torch.isfinite(baseline.logits(traces[0])).all()


LABELS = np.repeat(np.arange(3), 4)
TRACES = [make_trace(kind, index, 0.6) for kind in range(3) for index in range(4)]


def test_one_component_is_a_gaussian_of_all_frames_of_a_class(configured):
    baseline = configured("mfcc_gmm", components=1)
    baseline.fit(TRACES, LABELS, seed=0)
    frames = [baseline.coefficients(trace, 10_000) for trace in TRACES]
    expected = []
    for kind in range(3):
        own = np.concatenate(frames[4 * kind : 4 * kind + 4])
        deviation = np.sqrt(own.var(axis=0) + baseline.min_variance)
        expected.append(norm.logpdf(frames[2], own.mean(axis=0), deviation).sum())
    np.testing.assert_allclose(baseline.logits(TRACES[2])[:, 0], expected, rtol=1e-6)
    assert baseline.count_parameters() == 3 * (1 + 13 + 13)


def test_naive_bayes_is_a_gaussian_of_the_means_of_a_class(configured):
    baseline = configured("mfcc_nb")
    baseline.fit(TRACES, LABELS, seed=0)
    means = np.stack([baseline.features(trace) for trace in TRACES])
    own = means.reshape(3, 4, 13)
    smoothing = 1e-9 * means.var(axis=0).max()
    deviation = np.sqrt(own.var(axis=1) + smoothing)
    density = norm.logpdf(means[7], own.mean(axis=1), deviation).sum(axis=1)
    scores = torch.log_softmax(torch.from_numpy(density), dim=0)
    scores = scores.clamp(min=np.log(np.finfo(np.float64).tiny))
    torch.testing.assert_close(baseline.logits(TRACES[7])[:, 0], scores)
