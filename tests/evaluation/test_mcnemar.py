import pytest
from scipy.stats import binom

from tex_lightning.evaluation.comparison import mcnemar


def outcome(pattern: str) -> list[bool]:
    return [mark == "+" for mark in pattern]


def test_p_value_is_twice_the_binomial_tail():
    one, other = outcome("+++++++-+-" + "++++"), outcome("--------+-" + "++++")
    only_one, only_other, p = mcnemar(one, other)
    assert (only_one, only_other) == (7, 0)
    assert p == pytest.approx(2 * binom.cdf(0, 7, 0.5))


def test_order_of_the_systems_does_not_matter():
    one, other = outcome("++-+--+"), outcome("-++---+")
    assert mcnemar(one, other)[2] == mcnemar(other, one)[2]


def test_equal_systems_do_not_differ():
    assert mcnemar(outcome("+-+"), outcome("+-+")) == (0, 0, 1.0)
