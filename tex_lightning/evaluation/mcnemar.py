"""Test whether two systems differ on the samples that both classified."""

from collections.abc import Mapping

from scipy.stats import binomtest


def mcnemar(one: Mapping[str, bool], other: Mapping[str, bool]) -> tuple[int, int, float] | None:
    """Exact McNemar test of two systems' successes by sample.

    Only samples on which exactly one of them is right say anything; under the hypothesis of equal
    accuracy each of these is a fair coin.

    Args:
        one: Whether it was right, by sample.
        other: The same for the other system, on the same samples in any order.

    Returns:
        How often only ``one`` was right, how often only ``other`` was, and the two-sided p-value;
        None if they have not seen the same samples.
    """
    if not one or one.keys() != other.keys():
        return None
    first = sum(one[key] and not other[key] for key in one)
    second = sum(other[key] and not one[key] for key in one)
    if first + second == 0:
        return 0, 0, 1.0
    return first, second, float(binomtest(first, first + second).pvalue)
