"""Parts against exact fractions."""

from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.data.recordings import (
    cut_part,
    equal_parts,
    overlap,
    read_part,
    write_part,
)

BORDERS = st.floats(0, 1).map(lambda x: round(x, 9))
PARTS = st.tuples(BORDERS, BORDERS).filter(lambda part: part[0] < part[1])


@given(PARTS)
def test_text_gives_the_same_part_back(part):
    assert read_part(write_part(part)) == part


@given(PARTS, PARTS)
def test_parts_overlap_if_they_share_a_point_inside(one, other):
    shared = min(map(Fraction, (one[1], other[1]))) - max(map(Fraction, (one[0], other[0])))
    assert overlap(one, other) == overlap(other, one) == (shared > 0)
    assert overlap(one, None)
    assert overlap(None, other)


@given(st.integers(1, 12), st.integers(12, 60))
def test_equal_parts_hold_every_sample_once(count, samples):
    array, parts = np.arange(samples)[None], equal_parts(count)
    pieces = [cut_part(array, part, Path("a.wav")) for part in parts]
    np.testing.assert_array_equal(np.concatenate(pieces, axis=1), array)
    assert max(piece.shape[1] for piece in pieces) - min(piece.shape[1] for piece in pieces) <= 1
    assert not any(overlap(*pair) for pair in pairwise(parts))


@pytest.mark.parametrize("text", ["0.5", "0.5-0.5", "-1-0", "0-2", "a-b", "0-nan"])
def test_what_is_no_part_is_refused(text):
    with pytest.raises(ValueError):  # noqa: PT011
        read_part(text)
