import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.networks.blocks import MEAN, STD
from tex_lightning.senses.features.image import ImageFeatures, crop_side


def test_normalisation_is_per_colour():
    photo = torch.tensor([0, 128, 255], dtype=torch.uint8).view(1, 3, 1, 1)
    expected = [
        (value / 255 - mean) / std
        for value, mean, std in zip((0, 128, 255), MEAN, STD, strict=True)
    ]
    np.testing.assert_allclose(ImageFeatures()(photo).flatten(), expected, rtol=1e-5)


@pytest.mark.parametrize("angle", [0.0, 30.0, 45.0, 90.0, -135.0, 180.0])
def test_rotation_equals_opencv_and_has_no_black_corner(angle):
    patch, side = 64, crop_side(64, 180)
    smooth = cv2.GaussianBlur(
        np.random.default_rng(0).integers(60, 200, (side, side, 3)).astype(np.uint8), (0, 0), 2
    )
    crop = torch.from_numpy(smooth).permute(2, 0, 1)[None]
    features = ImageFeatures()
    rotated = features.rotated(crop, torch.tensor([angle]), patch)
    ours = (rotated * features.std + features.mean)[0].permute(1, 2, 0).numpy() * 255
    matrix = cv2.getRotationMatrix2D(((side - 1) / 2, (side - 1) / 2), angle, 1.0)
    turned = cv2.warpAffine(smooth.astype(np.float32), matrix, (side, side))
    edge = (side - patch) // 2
    theirs = turned[edge : edge + patch, edge : edge + patch]
    assert ours.min() > 50
    if (side - patch) % 2 == 0:
        assert np.abs(ours - theirs).max() < 2.0


@given(patch=st.integers(1, 60), angle=st.floats(-180, 180))
def test_a_slope_turns_into_a_slope(patch, angle):
    """Interpolation is exact on it, so that a pixel invented beyond the crop would show."""
    side = crop_side(patch, 180)
    crop = torch.arange(side, dtype=torch.uint8).expand(1, 3, side, side)
    features = ImageFeatures()
    turned = features.rotated(crop, torch.tensor([angle]), patch) * features.std + features.mean
    offset = np.arange(patch) - (patch - 1) / 2
    cos, sin = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    expected = (side - 1) / 2 + cos * offset - sin * offset[:, None]
    np.testing.assert_allclose(255 * turned[0, 1].numpy(), expected, atol=0.01)


def test_the_crop_is_just_large_enough():
    assert crop_side(100, 0) == 100
    assert crop_side(100, 45) == crop_side(100, 180)
    assert 100 * np.sqrt(2) <= crop_side(100, 90) <= 100 * np.sqrt(2) + 3
