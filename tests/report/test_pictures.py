"""Pictures of recordings and network inputs."""

import numpy as np
import pytest
import torch

from tex_lightning.report.pictures import captioned, input_pixels, recording_picture, row_of

RATE = 1_000


@pytest.mark.parametrize(
    ("shape", "size"),
    [
        ((4_000, 16), (640, 96)),  # many features of few fragments: a line of two pixels otherwise
        ((50, 3_000), (50, 640)),
        ((3, 1_000), (96, 640)),
        ((20, 30), (80, 120)),
        ((2_000, 3_000), (427, 640)),
    ],
)
def test_a_picture_can_be_seen_whatever_the_shape_of_the_input(shape, size):
    ramp = torch.linspace(0, 1, shape[0])[:, None].expand(shape)
    picture = input_pixels(ramp, object())
    assert picture.shape == (*size, 3)
    assert picture[0, :, 1].mean() > picture[-1, :, 1].mean() + 100  # the last row is on top


def test_a_signal_is_shown_by_its_frequencies_and_a_photo_by_its_middle():
    tone = np.sin(2 * np.pi * 0.4 * RATE * np.arange(2 * RATE) / RATE, dtype=np.float32)
    picture = recording_picture(tone[None], RATE, (64, 50)).astype(int).sum(axis=(1, 2))
    assert abs(int(picture.argmax()) - 10) <= 1  # a fifth from the top, which is half of the rate
    photo = np.zeros((40, 80, 3), np.uint8)
    photo[:, 20:60] = 200
    assert np.all(recording_picture(photo, None, (16, 16)) == 200)


def test_signs_of_other_languages_are_drawn_apart_from_each_other():
    white = np.full((48, 160, 3), 255, np.uint8)
    drawn = [row_of([white], [sign]).tobytes() for sign in "äöüßÄЖλ"]
    assert len({*drawn}) == len(drawn)  # signs that a font lacks are all one box


def test_a_caption_has_room_beside_a_narrow_picture():
    narrow = np.full((48, 100, 3), 255, np.uint8)
    short, long = (captioned([("i" * count, [narrow])]) for count in (3, 70))
    assert short.shape[1] == 100 < long.shape[1]
    assert captioned([("i" * 1000, [narrow])]).shape[1] == 320
