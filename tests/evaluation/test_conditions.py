"""Votes by condition: counts by hand."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest

from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import Recording
from tex_lightning.evaluation.conditions import by_condition, condition_bins, pool_conditions
from tex_lightning.evaluation.outcomes import Outcome


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
    entry = by_condition(SAMPLES, outcomes("+-++"), {})
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
    halves = (SAMPLES[:2], "+-"), (SAMPLES[2:], "++")
    parts = [by_condition(samples, outcomes(marks), {}) for samples, marks in halves]
    whole = by_condition(SAMPLES, outcomes("+-++"), {})
    assert counts(pool_conditions([*parts, {}])) == counts(whole)


def table(**columns: list[str]) -> list[Sample]:
    rows = zip(*columns.values(), strict=True)
    return [sample(n, haptic=dict(zip(columns, row, strict=True))) for n, row in enumerate(rows)]


def edges(samples: list[Sample]) -> dict[str, list[float]]:
    return condition_bins(each.recordings["haptic"] for each in samples)


def test_a_condition_of_many_values_has_five_bins_the_same_in_every_fold():
    values = np.random.default_rng(0).normal(-3, 2, 40)
    samples, marks = table(force=[f"{value:.6g}" for value in values]), "+-" * 20
    bins = edges(samples)
    whole = by_condition(samples, outcomes(marks), bins)["conditions"]["force"]
    limits = [tuple(map(float, key.split(" to "))) for key in whole]
    assert len(limits) == 5
    assert limits == sorted(limits)
    assert all(high == low for (_, high), (low, _) in pairwise(limits))
    assert [entry["test_samples"] for entry in whole.values()] == [8] * 5
    for (low, high), entry in zip(limits, whole.values(), strict=True):
        inside = [mark for value, mark in zip(values, marks, strict=True) if low <= value < high]
        assert abs(entry["correct"] - inside.count("+")) <= 1  # rounding, and the last edge
    folds = [by_condition(samples[n::4], outcomes(marks[n::4]), bins) for n in range(4)]
    assert pool_conditions(folds)["conditions"]["force"] == whole


@pytest.mark.parametrize(
    ("column", "keys"),
    [
        ([str(n % 12) for n in range(60)], 12),  # twelve persons, five recordings each
        ([str(n % 9) for n in range(12)], 9),
        ([f"2024-05-01T10:{n:02}" for n in range(60)], 0),  # when each was made
        ([f"{n}e-7" for n in range(1, 61)], 5),
        (["0"] * 48 + [str(n) for n in range(12)], 12),
        ([str(1e6 + n / 1000) for n in range(60)], 5),
        (["0"] * 20 + [str(n) for n in range(20)], 3),
        (["fast", *map(str, range(59))], 0),
    ],
)
def test_values_that_many_share_stay_and_words_that_none_share_go(column, keys):
    samples = table(value=column)
    entry = by_condition(samples, outcomes("+" * len(column)), edges(samples))
    found = entry.get("conditions", {}).get("value", {})
    assert len(found) == keys
    assert sum(each["test_samples"] for each in found.values()) in (0, len(column))
