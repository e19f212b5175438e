"""Votes by condition: counts by hand."""

from pathlib import Path

import pytest
from scipy.stats import binomtest

from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import Recording
from tex_lightning.evaluation.outcomes import Outcome, by_condition, pool_conditions


def sample(number: int, **senses: dict[str, str]) -> Sample:
    rows = {
        name: Recording("a", name, Path(f"{number}.{name}"), number, None, tuple(given.items()))
        for name, given in senses.items()
    }
    return Sample("a", rows)


def outcomes(marks: str) -> list[Outcome]:
    return [Outcome({}, "a", "ba"[mark == "+"], 1.0, 1, 1, 1.0) for mark in marks]


def counts(entry: dict) -> dict[str, dict[str, tuple[int, int]]]:
    return {
        name: {value: (found["correct"], found["test_samples"]) for value, found in values.items()}
        for name, values in entry["conditions"].items()
    }


SAMPLES = [
    sample(0, haptic={"speed": "100"}, image={"light": "lamp"}),
    sample(1, haptic={"speed": "60.0"}, image={"light": "sun"}),
    sample(2, haptic={"speed": "60"}, image={}),
    sample(3, haptic={"speed": "60"}, sound={"speed": "60.0", "room": "hall"}),
]


def test_every_sample_counts_once_for_each_condition_of_its_recordings():
    entry = by_condition(SAMPLES, outcomes("+-++"))
    assert counts(entry) == {
        "speed": {"60": (2, 3), "100": (1, 1)},
        "light": {"lamp": (1, 1), "sun": (0, 1)},
        "room": {"hall": (1, 1)},
    }
    assert list(entry["conditions"]["speed"]) == ["60", "100"]  # by size
    found = entry["conditions"]["speed"]["60"]
    interval = binomtest(2, 3).proportion_ci(method="wilson")
    assert found["vote_accuracy"] == pytest.approx(2 / 3)
    assert found["vote_ci95"] == pytest.approx([interval.low, interval.high])


def test_folds_are_pooled_by_their_counts():
    parts = [by_condition(SAMPLES[:2], outcomes("+-")), by_condition(SAMPLES[2:], outcomes("++"))]
    assert counts(pool_conditions([*parts, {}])) == counts(by_condition(SAMPLES, outcomes("+-++")))
