"""Numbers as people read them."""

from collections.abc import Sequence
from statistics import median as median_of


def spread(values: Sequence[float], unit: str, form: str, *, median: bool = False) -> str:
    """Least and largest of some numbers, once if they read alike, and the median if asked for.

    Args:
        values: At least one.
        unit: What stands behind them.
        form: Format of a number.
        median: Whether the median goes before them.
    """
    low, high = format(min(values), form), format(max(values), form)
    behind = f" {unit}" if unit else ""
    if low == high:
        return f"{low}{behind}"
    if median:
        return f"median {format(median_of(values), form)}{behind} ({low} to {high})"
    return f"{low} to {high}{behind}"
