"""Tests between systems, pairs of their samples, and the choice of one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from tex_lightning.evaluation.comparison import (
    MIN_SAMPLES,
    correct_shares,
    mcnemar,
    one_standard_error,
    pair,
    pareto,
)
from tex_lightning.evaluation.outcomes import Outcome


def marks(pattern: str) -> list[bool]:
    return [mark == "+" for mark in pattern]


def test_p_value_is_twice_the_binomial_tail():
    one, other = marks("+++++++-+-" + "++++"), marks("--------+-" + "++++")
    only_one, only_other, p = mcnemar(one, other)
    assert (only_one, only_other) == (7, 0)
    assert p == mcnemar(other, one)[2] == pytest.approx(2 * binom.cdf(0, 7, 0.5))
    assert mcnemar(marks("+-+"), marks("+-+")) == (0, 0, 1.0)


def choose(**votes: str) -> str:
    """The choice among a best system and a small, faster one; + where they are correct."""
    shares = {name: {(0, str(i)): x for i, x in enumerate(marks(v))} for name, v in votes.items()}
    return one_standard_error({"best": 10, "small": 1}, shares)


@pytest.mark.parametrize("n", [1, MIN_SAMPLES - 1, MIN_SAMPLES, 500])
def test_one_error_more_suffices_only_where_there_are_many_samples(n):
    """One discordant sample of n: the mean difference is 1/n and so is its standard error."""
    expected = "small" if n >= MIN_SAMPLES else "best"
    assert choose(best="+" * n, small="+" * (n - 1) + "-") == expected


@pytest.mark.parametrize(("errors", "expected"), [(5, "small"), (7, "best")])
def test_systems_without_a_common_sample_are_compared_as_if_independent(errors, expected):
    """2 and 4 samples of 100 more are wrong, with standard errors of 2.8 and 3.1."""
    votes = {}
    for name, wrong in (("best", 3), ("small", errors)):
        shares = marks("+" * (100 - wrong) + "-" * wrong)
        votes[name] = {(0, f"{name} {i}"): share for i, share in enumerate(shares)}
    assert one_standard_error({"best": 10, "small": 1}, votes) == expected


def test_pairing_counts_only_what_differs():
    """Equal accuracies of 1/2 on the same samples leave no doubt that one extra error matters."""
    differences = np.array([1] * 10 + [0] * 50)
    assert differences.mean() > differences.std(ddof=1) / np.sqrt(60)
    assert choose(best="+" * 30 + "-" * 30, small="+" * 20 + "-" * 40) == "best"


@given(
    st.dictionaries(
        st.sampled_from("abcdefgh"), st.tuples(st.integers(1, 9), st.integers(0, 9)), min_size=1
    )
)
def test_pareto_line_is_what_nobody_beats(points):
    line = pareto(points)
    assert line
    for name, (cost, accuracy) in points.items():
        beaten = any(
            (c <= cost and a > accuracy) or (c < cost and a >= accuracy) for c, a in points.values()
        )
        assert (name in line) == (not beaten)


def outcome(correct: bool, **files: str) -> Outcome:
    return Outcome(files, "oak", "oak" if correct else "ash", 1.0, 1, int(correct), 1.0)


def test_votes_are_those_on_the_joint_samples():
    photos = [outcome(n != 1, image=f"p{n}") for n in range(4)]
    both = [outcome(True, haptic=f"t{n % 2}", image=f"p{n}") for n in range(4)]
    assert correct_shares(photos, both) == {"t0": 1.0, "t1": 0.5}
    assert correct_shares(both, both) == {"t0": 1.0, "t1": 1.0}


def test_samples_that_are_not_in_the_joint_ones_stand_for_themselves():
    sounds = [outcome(n == 0, sound=f"s{n}") for n in range(2)]
    traces = [outcome(True, haptic="t0")]
    assert correct_shares(sounds, traces) == {"s0": 1.0, "s1": 0.0}
    assert pair(sounds, traces) is None
