"""Photos through OpenCV."""

import io

import cv2
import numpy as np
import pytest
from conftest import make_photo
from PIL import Image

from tex_lightning.errors import UserError
from tex_lightning.recording.camera import Camera, encode


@pytest.fixture
def pictures(tmp_path):
    for number in range(2):
        Image.fromarray(make_photo(number, 0)).save(tmp_path / f"p_{number:02d}.png")
    return tmp_path / "p_%02d.png"


def test_pictures_come_one_by_one_until_there_are_no_more(pictures):
    camera = Camera(str(pictures))
    for number in range(2):
        np.testing.assert_array_equal(camera.photo(), make_photo(number, 0))
    with pytest.raises(UserError, match=r"gives no picture .any more.; check the path"):
        camera.photo()
    camera.close()


def test_a_camera_that_is_not_there(capfd):
    with pytest.raises(UserError, match="cannot be opened; check that the camera is plugged in"):
        Camera("camera:93")
    assert capfd.readouterr().err == ""  # OpenCV has its say in words of its own
    with pytest.raises(UserError, match="names no camera; write camera:0"):
        Camera("camera:front")


def test_a_real_camera_settles_before_the_photo_is_taken(monkeypatch):
    class Capture:
        def __init__(self, number):
            assert number == 2
            self.grabbed = 0

        def isOpened(self):
            return True

        def grab(self):
            self.grabbed += 1

        def read(self):
            return True, np.full((4, 4, 3), self.grabbed, np.uint8)

    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    assert Camera("camera:2").photo().mean() == 5


def test_a_jpeg_has_the_colours_of_the_photo():
    blue_first = np.full((32, 32, 3), (250, 120, 10), np.uint8)
    with Image.open(io.BytesIO(encode(blue_first))) as image:
        assert image.format == "JPEG"
        np.testing.assert_allclose(np.asarray(image)[16, 16], (10, 120, 250), atol=3)
