"""Several senses in one recording."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from tex_lightning.recording import session as session_module
from tex_lightning.recording.session import Contact, Session, Signal
from tex_lightning.recording.sources import Source


def signal(rate, *pieces, seconds=0.1, **source):
    return Signal(
        "haptic", "haptic=-", Source(rate, lambda: (x for x in pieces), **source), seconds, 1
    )


def signals(levels):
    """A trace of chunks of these levels, and a sound that counts its samples."""
    tone = np.tile([-1.0, 1.0], 50)
    trace = np.concatenate([level * tone for level in levels])[None]
    return [signal(1000, trace), signal(8000, np.arange(800.0 * len(levels))[None])]


def test_by_time_recordings_follow_without_a_gap_and_senses_are_of_one_length():
    told = []
    trace, sound = both = signals([1.0] * 25)
    session = Session(both, 1.0, None, lambda chunk, level, recorded: told.append(recorded))
    with trace, sound:
        for number in range(2):
            assert session.record()
            assert (trace.seconds, sound.seconds) == (1.0, 1.0)
            assert sound.samples[0, 0] == 8000 * number
        assert not session.record()  # half a second is left
    assert (trace.seconds, sound.seconds) == (0.5, 0.5)
    assert told == [True] * 25


@pytest.mark.parametrize("silence", [6, 20])
def test_by_contact_all_senses_have_the_length_of_the_stroke(silence):
    told = []
    stroke = [1.0] * 7 + [0.01] * silence
    trace, sound = both = signals([0.01] * 5 + stroke + stroke)
    session = Session(both, 1.0, Contact(0.1), lambda chunk, level, said: told.append(said))
    with trace, sound:
        for number in range(2):
            assert session.record()
            assert (trace.seconds, sound.seconds) == (0.7, 0.7)
            assert np.abs(trace.samples).min() == 1
            assert sound.samples[0, 0] == 800 * (5 + number * len(stroke))  # side by side
        assert told[:6] == [False] * 5 + [True]
        assert not session.record()
    assert trace.count == 0


@pytest.mark.parametrize("timed", [True, False])
def test_pieces_become_chunks_and_their_rate_is_measured(monkeypatch, timed):
    clock = [100.0]
    monkeypatch.setattr(session_module, "time", SimpleNamespace(monotonic=lambda: clock[0]))

    def ramp():
        start = 0
        for size in (3, 25, 0, 7, 1, 30):
            clock[0] += 0.25
            yield None
            yield np.arange(start, start + size, dtype=np.float32)[None]
            start += size

    with Signal("haptic", "haptic=-", Source(100, ramp, timed), 0.1, 1) as sensor:
        chunks = [sensor.next() for _ in range(7)]
        assert sensor.next() is None
        assert sensor.next() is None  # it stays the end
    assert [chunk.shape[1] for chunk in chunks] == [10] * 6 + [6]
    np.testing.assert_array_equal(np.concatenate(chunks, axis=1)[0], np.arange(66))
    for chunk in chunks:
        sensor.add(chunk)
    said = "The trace arrives at 50 Hz, and record.haptic.rate is 100; correct that, or the sensor."
    assert sensor.warnings({}) == ((said,) if timed else ())


NOISE = np.random.default_rng(0).standard_normal((1, 10_000)).astype(np.float32)


@pytest.mark.parametrize(
    ("samples", "ranges", "warning"),
    [
        (NOISE.clip(-1, 1), {}, r"The trace is clipped, \d+% of it"),
        (NOISE, {"level": [5.0, 20.0]}, "The trace has a level of"),
        (NOISE, {"level": [0.5, 2.0]}, None),
    ],
)
def test_faults_are_those_of_a_prediction(samples, ranges, warning):
    sensor = signal(10_000)
    for chunk in np.split(samples, 10, axis=1):
        sensor.add(chunk)
    said = sensor.warnings(ranges)
    assert len(said) == (warning is not None)
    assert all(re.match(warning, text) for text in said)


def test_lost_samples_are_told_once():
    sensor = signal(10_000, lost=True)
    sensor.add(NOISE)
    assert sensor.warnings({}) == ("Samples of the trace were lost; close other programs.",)
    assert sensor.warnings({}) == ()


QUIET, STROKE = 0.01, 1.0


@pytest.mark.parametrize(
    ("levels", "expected"),
    [
        (
            [QUIET] * 10 + [STROKE] * 8 + [QUIET] * 3 + [STROKE] * 2 + [QUIET] * 10,
            [False] * 10 + [True] * (8 + 3 + 2 + 4) + [False] * 6,
        ),
        ([0.0] * 6 + [1e-6], [False] * 6 + [True]),
    ],
)
def test_a_stroke_is_from_the_first_loud_chunk_to_half_a_second_of_silence(levels, expected):
    contact, touching = Contact(0.1), []
    for value in levels:
        contact.update(value)
        touching.append(contact.touching)
    assert touching == expected
