"""Ranges of the training recordings."""

import numpy as np
import pytest
import soundfile

from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.inspection import training_ranges
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store

NOISE = np.random.default_rng(0).standard_normal((1, 20_000)).astype(np.float32)


def test_ranges_leave_out_the_oddest_recordings(tmp_path):
    rows = []
    for number in range(300):
        path = tmp_path / f"{number}.npy"
        np.save(path, NOISE[:, :600] * (1e6 if number == 0 else 1 + number / 100))
        rows.append(Recording("a", "haptic", path, number, 5000.0 if number else None))
    ranges = training_ranges(rows, Store(tmp_path, {"haptic": SignalDecoder()}))
    assert 0.9 < ranges["level"][0] < 1.2
    assert 3 < ranges["level"][1] < 5
    assert ranges["rate"] == pytest.approx([5000, 5000])


def test_a_dead_axis_of_all_recordings_is_usual_at_any_rate(tmp_path):
    rng, rows = np.random.default_rng(0), []
    for number in range(6):
        samples = rng.standard_normal((3_000, 2)) * [0.1, 0] + [0, 0.7]
        soundfile.write(path := tmp_path / f"{number}.wav", samples, 7_000 if number else 10_000)
        rows.append(Recording("a", "haptic", path, str(number)))
    ranges = training_ranges(rows, Store(tmp_path, {"haptic": SignalDecoder()}))
    assert ranges["constant"] == [1.0, 1.0]
    assert ranges["clipped"] == [0.0, 0.0]
