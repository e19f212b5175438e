"""Pixels in arrays: what is taken for a photo, and how it is made smaller."""

import numpy as np
import pytest
import torch
from PIL import Image

from tex_lightning_runtime.errors import UserError
from tex_lightning_runtime.pixels import as_pixels, halve, middle

PHOTO = np.random.default_rng(0).integers(0, 256, (57, 31, 3)).astype(np.uint8)


def test_halving_is_the_rounded_mean_of_blocks():
    blocks = PHOTO[:-1, :-1].reshape(28, 2, 15, 2, 3).astype(int)
    np.testing.assert_array_equal(halve(PHOTO), (blocks.sum((1, 3)) + 2) // 4)


@pytest.mark.parametrize("size", [(61, 41), (60, 40), (21, 90)])
def test_the_middle_is_the_same_before_and_after_halving(monkeypatch, size):
    monkeypatch.setattr("tex_lightning_runtime.pixels.MAX_PIXELS", 150)
    monkeypatch.setattr("tex_lightning_runtime.pixels.MAX_SIDE", 12)
    photo = np.random.default_rng(1).integers(0, 256, (*size, 3)).astype(np.uint8)
    before = halve(middle(photo, 2, "it"))
    np.testing.assert_array_equal(before, middle(halve(photo), 1, "it"))
    assert before.shape[0] * before.shape[1] <= 150 < size[0] * size[1] // 4


def test_arrays_tensors_and_greys_are_taken():
    np.testing.assert_array_equal(as_pixels(torch.from_numpy(PHOTO)), PHOTO)
    np.testing.assert_array_equal(as_pixels(PHOTO, colour="bgr"), PHOTO[..., ::-1])
    np.testing.assert_array_equal(as_pixels(Image.fromarray(PHOTO), colour="bgr"), PHOTO)
    np.testing.assert_array_equal(as_pixels(PHOTO[..., 0])[..., 2], PHOTO[..., 0])
    taken = as_pixels(np.broadcast_to(PHOTO[:1], PHOTO.shape))
    assert taken.flags.writeable
    with pytest.raises(UserError, match="colour is 'hsv'; choose rgb or bgr"):
        as_pixels(PHOTO, colour="hsv")
    for wrong in (PHOTO / 255, PHOTO[..., :2], PHOTO[:0], PHOTO[None]):
        with pytest.raises(UserError, match=r"^it is an array of .*; give uint8 pixels"):
            as_pixels(wrong, "it")
