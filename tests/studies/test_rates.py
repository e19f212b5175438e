"""Traces whose rate is lower than that of others."""

import numpy as np
import pytest

from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.data.store import Store
from tex_lightning.studies.notes import rate_warnings


@pytest.fixture
def warnings(tmp_path):
    """Warnings of traces of several lengths in samples and rates in Hz."""

    def warn(*traces: tuple[int, float | None], sampling_rate: float = 10_000.0) -> list[str]:
        rows = []
        for number, (samples, rate) in enumerate(traces):
            path = tmp_path / f"{number}_{samples}_{rate}.npy"
            np.save(path, np.ones(samples))
            rows.append(Recording("a", "haptic", path, 0, rate))
        store = Store(tmp_path / "cache", {"haptic": SignalDecoder(sampling_rate=sampling_rate)})
        return rate_warnings(Recordings(tuple(rows)), store)

    return warn


def test_traces_of_half_the_rate_of_others_are_pointed_out_unless_all_are_brought_to_it(warnings):
    usual, slow = [(20_000, 10_000.0)] * 6, [(9_000, 5_000.0)] * 2
    (warning,) = warnings(*usual, *slow)
    assert warning.startswith("2 of 8 traces have a lower rate than the 10,000 Hz of others, 5,000")
    assert warning.endswith("or set data.sampling_rate=5000.")
    assert warnings(*usual, (9_000, 8_000.0)) == warnings(*usual, *slow, sampling_rate=5e3) == []
