import numpy as np
import pytest

from tex_lightning.synthetic.tool import slide_tool

RATE = 10_000


def _trace(specimen, seed=0, seconds=1.5):
    return slide_tool(specimen, np.random.default_rng(seed), seconds, RATE)


def _rms(x):
    return float(np.sqrt(np.mean(np.square(x - x.mean(axis=-1, keepdims=True)))))


def test_tool_hangs_still_under_gravity_until_the_impact(specimen):
    for seed in range(5):
        trace = _trace(specimen(0), seed)
        lead = trace[:, :1900]
        assert np.linalg.norm(lead.mean(axis=1)) == pytest.approx(1.0, abs=0.05)
        assert _rms(lead) < 0.03
        moved = np.linalg.norm(trace - lead.mean(axis=1, keepdims=True), axis=0)
        landing = int(np.argmax(moved > 0.5))
        assert 0.2 * RATE <= landing <= 0.42 * RATE
        assert moved[landing : landing + 300].max() > 2


def test_feel_alikes_give_the_very_same_trace_from_the_same_random_numbers(specimen):
    np.testing.assert_array_equal(_trace(specimen(2), 3), _trace(specimen(3), 3))
    assert not np.array_equal(_trace(specimen(0), 3), _trace(specimen(1), 3))
