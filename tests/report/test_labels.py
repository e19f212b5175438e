"""Labels that make room for each other."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.report.labels import brief, spaced


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=12), st.floats(0.1, 10))
def test_places_are_apart_in_their_order_and_no_further_than_needed(places, gap):
    found = np.array(spaced(places, gap))
    order = np.argsort(places, kind="stable")
    assert (np.diff(found[order]) >= gap - 1e-9).all()
    assert np.abs(found.mean() - np.mean(places)) < 1e-6
    if len(places) > 1 and (np.diff(np.sort(places)) >= gap).all():
        np.testing.assert_allclose(found, places, atol=1e-9)


@given(st.lists(st.floats(0, 100), min_size=1, max_size=12), st.floats(0.1, 9))
def test_places_stay_on_their_axis(places, gap):
    """Twelve of them 9 apart take 99."""
    found = np.array(spaced(places, gap, 0, 100))
    assert (np.diff(found[np.argsort(places, kind="stable")]) >= gap - 1e-9).all()
    assert found.min() >= -1e-9
    assert found.max() <= 100 + 1e-9


def test_the_middle_of_a_long_name_is_left_out():
    assert brief("abcdefgh", 8) == "abcdefgh"
    assert brief("abcdefghi", 8) == "abcd…fghi"
