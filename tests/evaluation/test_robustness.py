"""Where a system fails: significantly lower, broken, and what is first."""

import pytest
from scipy.stats import binomtest

from tex_lightning.evaluation.robustness import StabilityRow, find_failures


def trials(perturbation: str, correct: list[int], gained: int = 0) -> list[StabilityRow]:
    """Trials of 40 samples by severity; more are lost where some of the wrong are right."""
    return [
        StabilityRow(
            "mine", "haptic", perturbation, severity, 40, count / 40, 0, 1, 0,
            (correct[0] - count + gained) * (severity > 0), gained * (severity > 0),
        )
        for severity, count in enumerate(correct)
    ]  # fmt: skip


def test_lower_is_what_the_exact_test_says_over_all_five_severities():
    (failure,) = find_failures(trials("noise", [40, 36, 33, 31, 25, 25]))
    levels = [binomtest(40 - count, 40 - count).pvalue for count in (36, 33, 31)]
    assert levels[1] < 0.05 and levels[1] > 0.01 > levels[2]  # noqa: PT018
    assert failure.lower.severity == 3
    assert (failure.broken, failure.breaking) == (None, None)


def test_what_is_lost_and_gained_alike_is_not_lower():
    (failure,) = find_failures(trials("noise", [30, 24, 24, 24, 24, 24], gained=10))
    assert failure.lower is None  # 16 lost and 10 gained, though 6 of 30 fewer


def test_better_than_unperturbed_is_no_failure():
    (failure,) = find_failures(trials("noise", [10, 30, 30, 30, 30, 30], gained=20))
    assert failure.lower is None


def test_the_breaking_point_is_where_half_of_the_clean_accuracy_is_crossed():
    (failure,) = find_failures(trials("noise", [32, 32, 24, 8, 16, 0]))
    assert failure.broken.severity == 3
    assert failure.breaking == pytest.approx(2.5)  # from 24 to 8 it passes 16 half-way
    (failure,) = find_failures(trials("noise", [32, 32, 32, 16, 16, 16]))
    assert failure.broken is None  # half of it is not less than half


def test_what_fails_first_is_in_front():
    rows = [
        *trials("never", [40] * 6), *trials("late", [40, 40, 40, 40, 40, 0]),
        *trials("lower", [40, 40, 25, 25, 25, 25]), *trials("early", [40, 10, 10, 10, 10, 10]),
    ]  # fmt: skip
    found = [failure.clean.perturbation for failure in find_failures(rows[::-1])]
    assert found == ["early", "late", "lower", "never"]
    assert find_failures([]) == []
