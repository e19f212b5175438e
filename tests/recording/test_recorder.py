"""Several signals in one recording."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from tex_lightning.errors import UserError
from tex_lightning.recording import recorder
from tex_lightning.recording.recorder import Signal
from tex_lightning.recording.sources import Source


def signal(rate, *pieces, timeout=1.0, **source):
    return Signal(
        "haptic", "haptic=-", Source(rate, lambda: (x for x in pieces), **source), timeout
    )


def test_recordings_follow_without_a_gap():
    samples = np.arange(2500.0)[None]
    with signal(1000, samples[:, :700], None, samples[:, 700:]) as sensor:
        for number in range(2):
            assert sensor.fill(1.0)
            np.testing.assert_array_equal(sensor.take(1.0)[0, :2], 1000 * number + np.arange(2))
        assert not sensor.fill(1.0)
        assert sensor.count == 500


def test_a_sensor_that_falls_silent_raises_an_error():
    def silent():
        time.sleep(0.4)
        yield None

    sensor = Signal("haptic", "haptic=-", Source(1000, silent), 0.1)
    with sensor, pytest.raises(UserError, match=r"has sent nothing for 0.1 s; check the sensor"):
        sensor.fill(1.0)


@pytest.mark.parametrize("timed", [True, False])
def test_the_rate_of_a_live_sensor_is_measured(monkeypatch, timed):
    clock = [100.0]
    monkeypatch.setattr(recorder, "time", SimpleNamespace(monotonic=lambda: clock[0]))

    def ramp():
        for start in range(0, 66, 11):
            clock[0] += 0.22
            yield np.arange(start, start + 11, dtype=np.float32)[None]

    with Signal("haptic", "haptic=-", Source(100, ramp, timed), 1) as sensor:
        assert not sensor.fill(1.0)
    message = "The trace arrives at 50 Hz, and record.haptic.rate is 100; correct that, or the "
    warnings = sensor.warnings(sensor.take(0.66))
    assert [text.startswith(message) for text in warnings] == [True] * timed


def test_clipping_and_lost_samples_are_reported():
    noise = np.random.default_rng(0).standard_normal((1, 10_000)).clip(-1, 1)
    warnings = signal(10_000, lost=True).warnings(noise)
    assert [text.split(",")[0] for text in warnings] == [
        "The trace is clipped", "Samples of the trace were lost; close other programs.",
    ]  # fmt: skip
