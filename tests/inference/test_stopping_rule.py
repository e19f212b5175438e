"""The stopping rule: never wrong when exact, wrong at most as often as alpha says otherwise."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import beta

from tex_lightning.inference.early_stopping import StoppingRule, is_confident, log_density

POPULATIONS = st.lists(st.integers(0, 3), min_size=1, max_size=60)


def run(rule: StoppingRule, fragments: list[int]) -> tuple[list[int], int]:
    """Votes and number of draws when the rule stops, looking only as often as it has to."""
    votes, drawn = [0] * rule.classes, 0
    while not rule.decided(votes, len(fragments) - drawn):
        more = rule.least_more(votes, len(fragments) - drawn)
        assert more >= 1
        for label in fragments[drawn : drawn + more]:
            votes[label] += 1
        drawn += more
    return votes, drawn


@given(POPULATIONS, st.randoms())
def test_the_exact_rule_never_differs_from_the_full_vote(fragments, random):
    random.shuffle(fragments)
    votes, drawn = run(StoppingRule(0.0, 4), fragments)
    full = np.bincount(fragments, minlength=4)
    if drawn < len(fragments):
        assert (full == full.max()).sum() == 1
        assert np.argmax(votes) == np.argmax(full)
    else:
        assert votes == full.tolist()


def test_unanimous_fragments_stop_at_the_closed_form():
    """Beta(n + 1, 1) has the density (n + 1) / 2^n at 1/2."""
    rule = StoppingRule(0.01, 11)
    least = next(n for n in range(100) if (n + 1) / 2**n <= 0.001)
    assert rule.least_more([0] * 11, 10_000) == least == 14
    assert rule.least_more([0] * 11, 9) == 5  # of nine, five cannot be outvoted


@given(st.integers(0, 200), st.integers(0, 200))
def test_the_density_is_that_of_scipy(first, second):
    assert log_density(first, second) == pytest.approx(
        beta(first + 1, second + 1).logpdf(0.5), abs=1e-8
    )


def crossing_probability(alpha: float, left: int, right: int) -> float:
    """Exact chance that drawing a population of two classes empty ever stops for the first."""
    rule = StoppingRule(alpha, 2)
    alive, wrong = {(0, 0): 1.0}, 0.0
    for _ in range(left + right):
        after: dict[tuple[int, int], float] = {}
        for (a, b), p in alive.items():
            rest = left + right - a - b
            for place, share in (((a + 1, b), (left - a) / rest), ((a, b + 1), (right - b) / rest)):
                if share == 0:
                    continue
                first, second = place
                # the statistical rule alone: that the population ends must not help
                if first > second and log_density(first, second) <= np.log(alpha):
                    wrong += p * share
                elif not (second > first and rule.decided([second, first], 10**9)):
                    after[place] = after.get(place, 0.0) + p * share
        alive = after
    return wrong


@pytest.mark.parametrize("alpha", [0.3, 0.05, 0.01])
def test_without_replacement_errors_stay_below_alpha_exactly(alpha):
    """Two equal halves are the worst case; every size is gone through without sampling."""
    chances = [crossing_probability(alpha, half, half) for half in (5, 10, 20, 40, 80)]
    assert max(chances) <= alpha
    assert all(earlier <= later for earlier, later in pairwise(chances))  # coins are the limit


def test_a_threshold_of_one_is_never_reached():
    assert is_confident(0.9, 0.9)
    assert not is_confident(1.0, 1.0)
