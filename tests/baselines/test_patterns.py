"""Local binary patterns: invariance, an independent count, and the command line."""

import numpy as np
import pytest
from conftest import make_photo

from tex_lightning.baselines.patterns import CODES, LocalBinaryPatterns


def test_quarter_turns_change_nothing():
    system = LocalBinaryPatterns(radii=[1, 2, 4], strength=1.0)
    photo = make_photo(0, 0, 120)
    for turns in (1, 2, 3):
        turned = np.ascontiguousarray(np.rot90(photo, turns))
        np.testing.assert_allclose(system.features(turned), system.features(photo), atol=2e-3)


def test_a_bright_dot_by_hand():
    """Around a dot every pattern is of the eight that see it, or sees no lower neighbour."""
    photo = np.full((9, 9, 3), 100, dtype=np.uint8)
    photo[4, 4] = 200
    shares = LocalBinaryPatterns(radii=[1], strength=1.0).features(photo)
    assert shares.shape == (CODES,)
    assert shares.sum() == pytest.approx(1)
    assert shares[0] == pytest.approx(1 / 49)  # the dot, all of whose neighbours are darker
