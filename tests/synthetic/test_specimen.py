import numpy as np
import pytest

from tex_lightning.synthetic.materials import FAMILIES, Body, ReliefSpec
from tex_lightning.synthetic.specimen import (
    MICRO_PITCH,
    MICRO_TILE,
    PITCH,
    TILE,
    make_micro,
    make_relief,
    smooth,
)


def _peak_wavelength(tile, pitch, axis):
    power = (np.abs(np.fft.rfft(tile, axis=axis)) ** 2).mean(axis=1 - axis)
    return 1 / np.fft.rfftfreq(tile.shape[axis], pitch)[1:][power[1:].argmax()]


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


@pytest.mark.parametrize("wavelength", [1.0, 2.5, 4.0])
def test_grooves_lie_at_their_wavelength_and_run_along_y(wavelength):
    tile = make_relief(ReliefSpec("grooved", wavelength, 0.05, seed=0))
    assert _peak_wavelength(tile, PITCH, axis=1) == pytest.approx(wavelength, rel=0.1)
    across = np.abs(np.diff(tile, axis=1)).mean()
    along = np.abs(np.diff(tile, axis=0)).mean()
    assert across > 2 * along


def test_micro_roughness_has_its_depth_and_wavelength():
    body = Body(1e5, 0.2, 0.4, 0.2, 1.0, micro_wavelength=0.2, micro_depth=0.001, seed=1)
    tile = make_micro(body)
    assert tile.shape == (MICRO_TILE, MICRO_TILE)
    assert tile.std() == pytest.approx(0.001, rel=1e-3)
    power = np.abs(np.fft.fft2(tile)) ** 2
    k = np.fft.fftfreq(MICRO_TILE, MICRO_PITCH)
    radius = np.hypot(k[:, None], k[None, :])
    assert (power * radius).sum() / power.sum() == pytest.approx(1 / 0.2, rel=0.35)


def test_smoothing_follows_the_closed_form_of_a_sine():
    x = np.arange(TILE) * PITCH
    wavelength = TILE * PITCH / 20
    tile = np.tile(np.sin(2 * np.pi * x / wavelength), (TILE, 1)).astype(np.float32)
    expected = np.exp(-0.5 * (2 * np.pi * 0.4 / wavelength) ** 2)
    np.testing.assert_allclose(smooth(tile, 0.4), expected * tile, atol=1e-4)
