import numpy as np

from tex_lightning.synthetic.camera import render_photo


def _photo(specimen, seed=0, light="daylight", size=(160, 120)):
    return render_photo(specimen, np.random.default_rng(seed), light, size)


def test_daylight_is_brighter_and_cooler_than_ambient_light(specimen):
    day = np.mean([_photo(specimen(0), s) for s in range(8)], axis=(0, 1, 2))
    room = np.mean([_photo(specimen(0), s, "ambient") for s in range(8)], axis=(0, 1, 2))
    assert day.sum() > 1.1 * room.sum()
    assert day[2] / day[0] > 1.1 * room[2] / room[0]


def test_look_alikes_give_the_very_same_photo_from_the_same_random_numbers(specimen):
    np.testing.assert_array_equal(_photo(specimen(0), 3), _photo(specimen(1), 3))
    assert not np.array_equal(_photo(specimen(2), 3), _photo(specimen(3), 3))
