"""SciPy's polyphase filter is the reference, to the last bit: samples seed FusionNet's tuples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import resample_poly

from tex_lightning.data.decode import rate_ratio
from tex_lightning_runtime import UserError
from tex_lightning_runtime.resampling import Resampler

RATES = st.sampled_from([1_000, 2_200, 8_000, 9_973.1, 10_000, 20_000, 44_100, 48_000])


@given(RATES, RATES, st.integers(1, 900), st.sampled_from(["f4", "f8"]), st.sampled_from([1, 3]))
def test_resamples_as_scipy_does(source, target, count, dtype, axes):
    x = np.random.default_rng(count).standard_normal((axes, count)).astype(dtype)
    ratio = rate_ratio(source, target, "it")
    expected = resample_poly(x, ratio.numerator, ratio.denominator, axis=1).astype(np.float32)
    np.testing.assert_array_equal(Resampler(source, target)(x), expected)


@given(RATES, st.integers(1, 4_000), st.integers(0, 900))
def test_later_samples_change_nothing_that_is_settled(source, before, after):
    x = np.random.default_rng(after).standard_normal((1, before + after))
    resample = Resampler(source, 10_000)
    settled = resample.settled(before)
    early, whole = resample(x[:, :before]), resample(x)
    np.testing.assert_array_equal(early[:, :settled], whole[:, :settled])
    np.testing.assert_array_equal(resample(x, settled), whole[:, settled:])


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), 1.0, 1e9])
def test_refuses_rates_that_are_none(rate):
    with pytest.raises(UserError, match="Hz"):
        Resampler(rate, 10_000)
