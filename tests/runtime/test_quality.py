"""Warnings are those of the package, word for word."""

import numpy as np
import pytest
from conftest import make_photo, make_trace
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.data.decode import halve as reference
from tex_lightning.data.quality import TraceMonitor, trace_measures
from tex_lightning.data.quality import photo_quality as photo_reference
from tex_lightning_runtime.quality import halve, photo_quality, trace_quality

TRACE = {"what": "trace", "rate": 10_000.0, "ranges": {"level": [0.1, 0.3], "rate": [9e3, 1e4]}}
PHOTO = {"brightness": [100.0, 140.0], "contrast": [30.0, 60.0]}
AXES = np.stack([make_trace(kind, 0, 0.2) for kind in range(3)])
TRACES = {
    "good": AXES,
    "silent": 0 * AXES,
    "constant": 0 * AXES + 2,
    "one axis constant": AXES * [[1], [0], [1]],
    "clipped": AXES.clip(-0.1, 0.1),
    "coarse": AXES.round(1),
    "loud": 100 * AXES,
    "faint, beside gravity": 1e-3 * AXES + 9.81,
}


@pytest.mark.parametrize("name", TRACES)
@pytest.mark.parametrize("rate", [2_000.0, 10_000.0, 44_100.0])
def test_traces(name, rate):
    raw = TRACES[name]
    monitor, trace = TraceMonitor("trace"), raw.astype(np.float32)
    monitor.update(raw)
    expected = monitor.quality(TRACE["ranges"], **trace_measures(trace, rate, 10_000.0))
    assert trace_quality(raw, trace, rate, TRACE) == ([*expected.warnings], expected.empty)


@pytest.mark.parametrize("half", [True, False])
@pytest.mark.parametrize("gain", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("side", [41, 1_300])
def test_photos(half, gain, side):
    photo = (make_photo(1, 0, side)[: side - 8] * gain).astype(np.uint8)
    expected = photo_reference(reference(photo) if half else photo, PHOTO, "photo")
    found = photo_quality(photo, {"what": "photo", "half_scale": half, "ranges": PHOTO})
    assert found == ([*expected.warnings], expected.empty)


@given(st.integers(2, 40), st.integers(2, 40), st.integers(1, 5))
def test_halving(height, width, step):
    photo = np.random.default_rng(height).integers(0, 256, (height, width, 3), np.uint8)
    np.testing.assert_array_equal(halve(photo, step), reference(photo)[::step, ::step])
