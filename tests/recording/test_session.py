"""Several senses in one recording."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from tex_lightning.data.quality import level
from tex_lightning.recording import session as feed_module
from tex_lightning.recording.session import Contact, Feed, Session, Track
from tex_lightning.recording.sources import Source


class ReadyFeed:
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
        Track("haptic", ReadyFeed(1000, trace)),
        Track("sound", ReadyFeed(8000, np.arange(800.0 * len(levels)))),
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


class Pieces(Source):
    """Pieces of a ramp, each so many seconds after the one before."""

    rate = 100

    def __init__(self, sizes, seconds, clock):
        self.sizes, self.seconds, self.clock = sizes, seconds, clock

    def chunks(self):
        place = 0
        for size in self.sizes:
            self.clock[0] += self.seconds
            yield None
            yield np.arange(place, place + size, dtype=np.float32)[None]
            place += size


@pytest.mark.parametrize("timed", [True, False])
def test_pieces_become_chunks_and_their_rate_is_measured(monkeypatch, timed):
    clock = [100.0]
    monkeypatch.setattr(feed_module, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    source = Pieces([3, 25, 0, 7, 1, 30], 0.25, clock)
    source.timed = timed
    with Feed("haptic=-", source, 0.1, 1) as feed:
        found = [feed.next() for _ in range(7)]
        assert feed.next() is None  # it stays the end
    assert [chunk.shape[1] for chunk in found] == [10] * 6 + [6]
    np.testing.assert_array_equal(np.concatenate(found, axis=1)[0], np.arange(66))
    assert feed.arrival_rate == (63 / 1.25 if timed else None)


NOISE = np.random.default_rng(0).standard_normal((1, 10_000)).astype(np.float32)


def track(samples, *, lost=False, arrival_rate=None):
    source = SimpleNamespace(lost=lost)
    feed = SimpleNamespace(rate=10_000, source=source, arrival_rate=arrival_rate)
    made = Track("haptic", feed)
    for chunk in np.split(samples, 10, axis=1):
        made.add(chunk, most=10_000)
    return made


@pytest.mark.parametrize(
    ("samples", "warning"),
    [
        (NOISE.clip(-1, 1), r"The trace is clipped, \d+% of it"),
        (0 * NOISE, "The trace is silent, so nothing was measured; check the sensor"),
        (np.concatenate([NOISE, 0 * NOISE + 1, NOISE]), "Axis 2 of the trace is constant"),
        (np.round(2 * NOISE), r"The trace is too quiet: it has only 1\d different"),
    ],
)
def test_defects_of_a_sensor(samples, warning):
    (said,) = track(samples).warnings({})
    assert re.match(warning, said)


def test_lost_samples_are_told_once_and_a_sensor_of_another_rate():
    made = track(NOISE, lost=True, arrival_rate=9100.0)
    assert made.warnings({}) == ("Samples of the trace were lost; close other programs.",)
    assert made.warnings({}) == ()
    (said,) = track(NOISE, arrival_rate=8000.4).warnings({})
    assert said.startswith("The trace arrives at 8000 Hz, and record.haptic.rate is 10000;")


def test_a_good_recording_and_one_unlike_the_training():
    assert track(NOISE).warnings({}) == ()
    assert track(NOISE).warnings({"level": [0.5, 2.0]}) == ()
    (said,) = track(NOISE).warnings({"level": [5.0, 20.0]})
    assert "has a level of" in said


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


def test_any_signal_is_contact_after_digital_silence():
    assert touches([0.0] * 6 + [1e-6])[-1]
