"""What is said of a recording when it is over."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from tex_lightning.recording.track import Track

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
        (np.round(2 * NOISE), r"Axis 1 of the trace is too quiet: it has only 1\d different"),
    ],
)
def test_defects_of_a_sensor(samples, warning):
    (said,) = track(samples).warnings({})
    assert re.match(warning, said)


def test_a_good_recording_and_one_unlike_the_training():
    assert track(NOISE).warnings({}) == ()
    assert track(NOISE).warnings({"level": [0.5, 2.0]}) == ()
    (said,) = track(NOISE).warnings({"level": [5.0, 20.0]})
    assert "has a level of" in said


def test_lost_samples_are_told_once():
    made = track(NOISE, lost=True)
    assert made.warnings({}) == ("Samples of the trace were lost; close other programs.",)
    assert made.warnings({}) == ()


def test_a_sensor_of_another_rate_is_noticed():
    assert track(NOISE, arrival_rate=9100.0).warnings({}) == ()
    (said,) = track(NOISE, arrival_rate=8000.4).warnings({})
    assert said.startswith("The trace arrives at 8000 Hz, and record.haptic.rate is 10000;")


def test_no_more_than_was_asked_for_is_kept():
    made = track(NOISE)
    made.add(NOISE, most=10_500)
    assert made.samples.shape == (1, 10_500)
    made.cut(700)
    assert (made.samples.shape, made.seconds) == ((1, 700), 0.07)
    np.testing.assert_array_equal(made.samples, NOISE[:, :700])
