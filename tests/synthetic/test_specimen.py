import numpy as np
import pytest

from tex_lightning.synthetic.materials import FAMILIES, ReliefSpec
from tex_lightning.synthetic.specimen import (
    PITCH,
    TILE,
    make_relief,
    smooth,
)


@pytest.mark.parametrize("family", FAMILIES)
def test_relief_has_the_depth_asked_for_and_wraps_around(family):
    spec = ReliefSpec(family, 2.0, 0.08, seed=3)
    tile = make_relief(spec)
    assert tile.shape == (TILE, TILE)
    assert tile.dtype == np.float32
    assert tile.mean() == pytest.approx(0, abs=1e-5)
    assert tile.std() == pytest.approx(0.08, rel=1e-3)
    for axis in (0, 1):
        steps = np.abs(np.diff(tile, axis=axis, append=tile.take([0], axis=axis)))
        seam = steps.take(-1, axis=axis).mean()
        assert seam < 2 * steps.mean()


def test_smoothing_follows_the_closed_form_of_a_sine():
    x = np.arange(TILE) * PITCH
    wavelength = TILE * PITCH / 20
    tile = np.tile(np.sin(2 * np.pi * x / wavelength), (TILE, 1)).astype(np.float32)
    expected = np.exp(-0.5 * (2 * np.pi * 0.4 / wavelength) ** 2)
    np.testing.assert_allclose(smooth(tile, 0.4), expected * tile, atol=1e-4)
