"""Several senses in one recording."""

import numpy as np
import pytest

from tex_lightning.recording.contact import Contact
from tex_lightning.recording.session import Session
from tex_lightning.recording.track import Track


class Feed:
    """Chunks of 0.1 s that are all there at once."""

    def __init__(self, rate, samples):
        self.rate, self.size = rate, rate // 10
        self.chunks = [samples[None, n : n + self.size] for n in range(0, len(samples), self.size)]
        self.ready, self.taken = True, 0

    def next(self):
        self.taken += bool(self.chunks)
        return self.chunks.pop(0) if self.chunks else None


def tracks(levels):
    """A trace of chunks of these levels, and a sound that counts its samples."""
    tone = np.tile([-1.0, 1.0], 50)
    trace = np.concatenate([level * tone for level in levels])
    return [
        Track("haptic", Feed(1000, trace)),
        Track("sound", Feed(8000, np.arange(800.0 * len(levels)))),
    ]


def session(made, contact):
    told = []
    return Session(made, 1.0, contact, lambda chunk, level, recorded: told.append(recorded)), told


def test_by_time_recordings_follow_without_a_gap_and_senses_are_of_one_length():
    trace, sound = made = tracks([1.0] * 25)
    by_time, told = session(made, None)
    for number in range(2):
        assert by_time.record()
        assert (trace.seconds, sound.seconds) == (1.0, 1.0)
        assert sound.samples[0, 0] == 8000 * number
    assert not by_time.record()  # half a second is left
    assert (trace.seconds, sound.seconds) == (0.5, 0.5)
    assert told == [True] * 25


@pytest.mark.parametrize("silence", [6, 20])
def test_by_contact_all_senses_have_the_length_of_the_stroke(silence):
    stroke = [1.0] * 7 + [0.01] * silence
    trace, sound = made = tracks([0.01] * 5 + stroke + stroke)
    by_contact, told = session(made, Contact(0.1))
    for number in range(2):
        assert by_contact.record()
        assert (trace.seconds, sound.seconds) == (0.7, 0.7)
        assert np.abs(trace.samples).min() == 1
        assert sound.samples[0, 0] == 800 * (5 + number * len(stroke))  # side by side
    assert told[:6] == [False] * 5 + [True]
    assert not by_contact.record()
    assert trace.count == 0
