"""Rules that stop a vote when the remaining fragments need not be computed.

The fragments are drawn in random order, without replacement, from the full set whose vote is the
decision, so that neighbouring fragments with overlapping windows do no harm: their dependence lies
in what is drawn from, not in the drawing.
"""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, lgamma, log


@dataclass(frozen=True)
class StoppingRule:
    """Stop when more fragments cannot, or hardly can, change the winner of the vote.

    *Exact*: the leader's distance from the second is larger than the number of fragments left.

    *PPR-1v1* (Jain et al., "PAC mode estimation using PPR martingale confidence sequences",
    AISTATS 2022): between two classes the draws are those of a coin. A uniform prior over its bias
    has a posterior density of f at 1/2 after a and b draws, and 1/f is, for the class that does not
    have the majority, as unlikely to ever exceed c as 1/c. The rule stops when
    f <= alpha / (classes - 1) for the leader against the second, and so against each of the others.
    Draws without replacement only make a wrong stop less likely: between two equal halves, the
    worst case, a sequence with a against b is then less probable than tosses of a fair coin
    wherever (a - b)^2 > a + b, and the rule never stops elsewhere.

    Args:
        alpha: Probability, in [0, 1), that the label differs from that of the full vote, whatever
            the fragments and however often the rule is asked; 0 leaves the exact rule alone.
        classes: Number of classes, at least 2.
    """

    alpha: float
    classes: int

    def decided(self, votes: Sequence[float], remaining: int) -> bool:
        """Whether to stop.

        Args:
            votes: (classes,) fragments for each class so far; for the exact rule also sums of what
                they give each class, from 0 to 1.
            remaining: Fragments not yet drawn.
        """
        second, first = sorted(votes)[-2:]
        if remaining == 0 or first - second > remaining:
            return True
        if first == second or self.alpha == 0:
            return False
        return log_density(first, second) <= log(self.alpha / (self.classes - 1))

    def least_more(self, votes: Sequence[int], remaining: int) -> int:
        """Smallest number of further fragments, all for the leader, after which the rule stops."""
        leader = max(range(len(votes)), key=votes.__getitem__)

        def decided(more: int) -> bool:
            more_votes = [n + more * (label == leader) for label, n in enumerate(votes)]
            return self.decided(more_votes, remaining - more)

        return bisect_left(range(remaining + 1), True, key=decided)


def log_density(first: float, second: float) -> float:
    """Logarithm of the density at 1/2 of the Beta(first + 1, second + 1) distribution."""
    count = first + second
    return lgamma(count + 2) - lgamma(first + 1) - lgamma(second + 1) - count * log(2)


def is_confident(probability: float, threshold: float) -> bool:
    """Whether a mean class probability decides; a threshold of 1 or more is never reached."""
    return probability >= (threshold if threshold < 1 else inf)
