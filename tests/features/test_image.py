import cv2
import numpy as np
import pytest
import torch

from tex_lightning.features.image import MEAN, STD, ImageFeatures, crop_side


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


def test_the_crop_is_just_large_enough():
    assert crop_side(100, 0) == 100
    assert crop_side(100, 45) == crop_side(100, 180)
    assert 100 * np.sqrt(2) <= crop_side(100, 90) <= 100 * np.sqrt(2) + 3


def test_scales_agree_with_opencv():
    photo = np.random.default_rng(3).integers(0, 256, (40, 60, 3), dtype=np.uint8)
    same, double = ImageFeatures(scales=(1.0, 2.0)).pyramid(torch.from_numpy(photo))
    np.testing.assert_array_equal(same[0].permute(1, 2, 0), photo)
    expected = cv2.resize(photo.astype(np.float32), (120, 80), interpolation=cv2.INTER_LINEAR)
    np.testing.assert_allclose(double[0].permute(1, 2, 0), expected, atol=1e-3)


def test_zoom_shows_the_middle_enlarged():
    """Twice as large, a patch is the middle half of the crop, interpolated."""
    features = ImageFeatures()
    crop = torch.arange(33.0).expand(1, 3, 33, 33).to(torch.uint8)  # a ramp from left to right
    still = torch.zeros(1)
    plain = features.rotated(crop, still, 17)
    zoomed = features.rotated(crop, still, 17, torch.tensor([2.0]))
    steps = (zoomed[0, 0, 8].diff() / plain[0, 0, 8].diff()).round(decimals=4)
    assert torch.equal(steps, torch.full((16,), 0.5))
    torch.testing.assert_close(zoomed[..., 8, 8], plain[..., 8, 8])
