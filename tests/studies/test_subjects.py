"""Recordings that a network is timed on."""

from types import SimpleNamespace

import numpy as np
import pytest

from tex_lightning.data.decode import SignalDecoder
from tex_lightning.tasks.profile import render_recording


@pytest.mark.parametrize("rate", [50.0, 500.0, 900.0, 10_000.0])
def test_a_trace_is_rendered_at_any_rate_of_a_sense(rate):
    sense = SimpleNamespace(decoder=SignalDecoder(sampling_rate=rate))
    trace = render_recording(sense, SimpleNamespace(seconds=2.0), 0)
    assert trace.shape == (3, 2 * rate)
    assert np.isfinite(trace).all()
