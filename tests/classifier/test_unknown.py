import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.classifier.card import least_rate, novelty_threshold


@given(st.integers(1, 60), st.floats(0.01, 0.99))
def test_a_new_recording_among_the_known_ones_is_rejected_rarely_enough(count, rate):
    """Each of n + 1 is as likely to be the new one, so all are tried."""
    every = np.random.default_rng(count).permutation(count + 1).astype(float)
    rejected = [new > novelty_threshold([*every[every != new]], rate) for new in every]
    assert np.mean(rejected) <= max(rate, least_rate(count)) + 1e-9
    if rate >= least_rate(count):  # and hardly less often
        assert np.mean(rejected) > rate - least_rate(count) - 1e-9


def test_the_threshold_is_the_conformal_quantile():
    known = np.random.default_rng(0).exponential(size=99)
    expected = np.quantile(known, 95 / 99, method="inverted_cdf")
    assert novelty_threshold(known.tolist(), 0.05) == pytest.approx(expected)


def test_of_too_few_recordings_the_largest_counts():
    assert novelty_threshold([0.2, 0.5, 0.3], 0.05) == 0.5
    assert least_rate(3) == 0.25
