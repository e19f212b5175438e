"""Traces whose assumed rate is probably wrong."""

import numpy as np
import pytest

from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.data.store import Store
from tex_lightning.report.durations import mixed_rates, spread, unlike_the_others


@pytest.fixture
def make(tmp_path):
    def make(samples, rate=None, label="a"):
        path = tmp_path / f"{label}_{samples}_{rate}.npy"
        np.save(path, np.ones(samples))
        return Recording(label, "haptic", path, 0, rate)

    return make


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "cache", {"haptic": SignalDecoder()})


def test_assumed_durations_far_from_the_median_are_pointed_out(make, store):
    usual = [make(20_000 + i, label="usual") for i in range(6)]
    slow = [make(5_000 + i, label="slow") for i in range(3)]
    warning = unlike_the_others(Recordings((*usual, *slow)), store)
    assert warning.startswith("Is 10,000 Hz the rate of all files that name none?")
    assert "median of 2 s: slow, 0.5 s (3 files, " in warning
    assert str(slow[0].path) in warning
    assert "data.file_rate" in warning
    assert "usual" not in warning.replace(str(usual[0].path.parent), "")
    assert unlike_the_others(Recordings(tuple(usual)), store) is None
    assert unlike_the_others(Recordings(()), store) is None


def test_rates_that_are_known_are_left_alone(make, store):
    usual = [make(20_000 + i, 10_000.0) for i in range(3)]
    known = [make(5_000 + i, 10_000.0) for i in range(2)]
    assert unlike_the_others(Recordings((*usual, *known)), store) is None
    assert unlike_the_others(Recordings((*usual, make(5_009))), store) is not None


def test_spreads_read_alike_once():
    assert spread([2.401, 2.404], "s", ".3g") == "2.4 s"
    assert spread([1, 2, 6], "", "d") == "1 to 6"


def test_traces_of_half_the_rate_of_others_are_pointed_out_unless_all_are_brought_to_it(
    make, store
):
    usual = [make(20_000 + i, 10_000.0) for i in range(6)]
    slow = [make(9_000 + i, 5_000.0) for i in range(2)]
    rows = Recordings((*usual, *slow))
    warning = mixed_rates(rows, store)
    assert warning.startswith("2 of 8 traces have a lower rate than the 10,000 Hz of others, 5,000")
    assert slow[0].path.name in warning
    assert warning.endswith("or set data.sampling_rate=5000.")
    assert mixed_rates(Recordings((*usual, make(9_000, 8_000.0))), store) is None
    lower = Store(store.root, {"haptic": SignalDecoder(sampling_rate=5_000.0)})
    assert mixed_rates(rows, lower) is None
