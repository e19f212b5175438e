"""Recordings are decoded and judged as by the package: to the last bit, word for word."""

import numpy as np
import pytest
from conftest import make_photo, make_trace
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import resample_poly

from tex_lightning.data.decode import halve as reference
from tex_lightning.data.decode import rate_ratio
from tex_lightning.data.quality import limits, trace_measures, trace_quality
from tex_lightning.data.quality import photo_quality as photo_reference
from tex_lightning_runtime.recordings import decode, resample

LEVELS = {"level": [0.1, 0.3], "rate": [9e3, 1e4]}
LIGHT = {"brightness": [100.0, 140.0], "contrast": [30.0, 60.0]}
TRACE = {
    "modality": "haptic", "what": "trace", "medium": "signal", "rate": 10_000.0, "axes": [1, 3],
    "channels": None, "limits": limits(LEVELS),
}  # fmt: skip
PHOTO = {"modality": "image", "what": "photo", "medium": "photo", "least": 1}
RATES = st.sampled_from([1_000, 2_200, 8_000, 9_973.1, 10_000, 20_000, 44_100, 48_000])
AXES = np.stack([make_trace(kind, 0, 0.2) for kind in range(3)])
TRACES = {
    "good": AXES,
    "silent": 0 * AXES,
    "constant": 0 * AXES + 2,
    "one axis constant": AXES * [[1], [0], [1]],
    "clipped": AXES.clip(-0.1, 0.1),
    "coarse": AXES.round(1),
    "slow": np.sin(np.arange(143) / 20)[None].round(2),
    "loud": 100 * AXES,
    "faint, beside gravity": 1e-3 * AXES + 9.81,
}


@pytest.mark.parametrize("name", TRACES)
@pytest.mark.parametrize("rate", [2_000.0, 10_000.0, 44_100.0])
def test_traces(name, rate):
    found = decode(TRACES[name], TRACE, rate)
    measures = trace_measures(found.array, rate, 10_000.0)
    expected = trace_quality(TRACES[name], LEVELS, "trace", measures)
    assert (found.warnings, found.empty) == ([*expected.warnings], expected.empty)


@pytest.mark.parametrize("half", [True, False])
@pytest.mark.parametrize("gain", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("side", [41, 1_300])
def test_photos(half, gain, side):
    photo = (make_photo(1, 0, side)[: side - 8] * gain).astype(np.uint8)
    expected = photo_reference(reference(photo) if half else photo, LIGHT, "photo")
    found = decode(photo, {**PHOTO, "half_scale": half, "limits": limits(LIGHT)})
    assert (found.warnings, found.empty) == ([*expected.warnings], expected.empty)
    np.testing.assert_array_equal(found.array, photo)


@given(RATES, RATES, st.integers(1, 900), st.sampled_from(["f4", "f8"]), st.sampled_from([1, 3]))
def test_resamples_as_scipy_does(source, target, count, dtype, axes):
    x = np.random.default_rng(count).standard_normal((axes, count)).astype(dtype)
    ratio = rate_ratio(source, target, "it")
    expected = resample_poly(x, ratio.numerator, ratio.denominator, axis=1).astype(np.float32)
    np.testing.assert_array_equal(resample(x, source, target), expected)
