"""The novelty above which a recording is called unknown."""

from collections.abc import Sequence

LABEL = "unknown"
ROUNDING = 1e-9  # of a rate times a number of recordings


def novelty_threshold(known: Sequence[float], rate: float) -> float:
    """The novelty above which a recording is called unknown: split conformal prediction.

    If known recordings to come are exchangeable with the n given, each has a chance of at most
    k / (n + 1) to lie above the k-th largest of these (Vovk et al. 2005, Lei et al. 2018). Where
    not even 1 / (n + 1) is as small as ``rate`` the largest is taken, see :func:`least_rate`.

    Args:
        known: Novelties of recordings of known classes that nothing was fitted on, at least one.
        rate: Share of known recordings that may be called unknown, in (0, 1).
    """
    place = max(1, int((len(known) + 1) * rate + ROUNDING))
    return sorted(known)[-place]


def least_rate(known: int) -> float:
    """The smallest rate of false rejections that so many recordings can guarantee."""
    return 1 / (known + 1)
