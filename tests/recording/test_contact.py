"""When a stroke begins and ends."""

import numpy as np
import pytest

from tex_lightning.recording.contact import Contact, level

QUIET, STROKE = 0.01, 1.0


def touches(levels, seconds=0.1):
    contact, found = Contact(seconds), []
    for value in levels:
        contact.update(value)
        found.append(contact.touching)
    return found


def test_level_is_the_deviation_of_all_axes_whatever_their_offsets():
    rng = np.random.default_rng(0)
    chunk = rng.normal([[0], [9.81], [-2]], 1, (3, 1000))
    expected = np.linalg.norm((chunk - chunk.mean(axis=1, keepdims=True)).ravel()) / 1000**0.5
    assert level(chunk.astype(np.float32)) == pytest.approx(expected, rel=1e-5)


def test_a_stroke_is_from_the_first_loud_chunk_to_half_a_second_of_silence():
    levels = [QUIET] * 10 + [STROKE] * 8 + [QUIET] * 3 + [STROKE] * 2 + [QUIET] * 10
    expected = [False] * 10 + [True] * (8 + 3 + 2 + 4) + [False] * 6
    assert touches(levels) == expected


def test_noise_of_twice_the_first_level_is_no_contact():
    assert not any(touches([QUIET] * 5 + [2 * QUIET] * 20))


def test_any_signal_is_contact_after_digital_silence():
    assert touches([0.0] * 6 + [1e-6])[-1]
