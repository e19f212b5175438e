import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.evaluation.choice import Candidate, one_standard_error, pareto, within_budget


def candidate(name: str, cost: float, pattern: str) -> Candidate:
    return Candidate(name, cost, {str(i): mark == "+" for i, mark in enumerate(pattern)})


def test_cheaper_system_with_one_error_more_is_enough():
    """One discordant sample of n: the mean difference is 1/n and so is its standard error."""
    best, small = candidate("best", 10, "+" * 50), candidate("small", 1, "+" * 49 + "-")
    assert one_standard_error([best, small]).name == "small"


def test_cheaper_system_that_is_clearly_worse_is_not_enough():
    best, small = candidate("best", 10, "+" * 50), candidate("small", 1, "+" * 40 + "-" * 10)
    assert one_standard_error([best, small]).name == "best"


def test_pairing_counts_only_what_differs():
    """Equal accuracies of 1/2 on the same samples leave no doubt that one extra error matters."""
    best = candidate("best", 10, "+" * 30 + "-" * 30)
    worse = candidate("worse", 1, "+" * 20 + "-" * 40)
    differences = np.array([1] * 10 + [0] * 50)
    assert differences.mean() > differences.std(ddof=1) / np.sqrt(60)
    assert one_standard_error([best, worse]).name == "best"


def test_dearer_systems_are_never_chosen_for_a_tie():
    pair = [candidate("dear", 2, "++-"), candidate("cheap", 1, "+-+")]
    assert one_standard_error(pair).name == "cheap"


POINTS = st.dictionaries(
    st.text(min_size=1), st.tuples(st.integers(1, 9), st.integers(0, 9)), min_size=1
)


@given(POINTS)
def test_pareto_line_is_what_nobody_beats(points):
    line = pareto(points)
    assert line
    for name, (cost, accuracy) in points.items():
        beaten = any(
            (c <= cost and a > accuracy) or (c < cost and a >= accuracy) for c, a in points.values()
        )
        assert (name in line) == (not beaten)


@pytest.mark.parametrize(
    ("cost", "accuracy", "expected"),
    [(5, None, "middle"), (None, 0.6, "middle"), (None, 0.5, "small"), (0.5, None, None)],
)
def test_budgets(cost, accuracy, expected):
    family = [
        candidate("small", 1, "++--"),
        candidate("middle", 4, "+++-"),
        candidate("large", 9, "++++"),
    ]
    found = within_budget(family, cost, accuracy)
    assert (found.name if found else None) == expected
