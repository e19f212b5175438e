"""Decision rules: from the class scores of fragments to the label (paper, section III-B).

Votes are counted on the CPU in float64, so that every device decides alike on the same scores.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from tex_lightning.errors import UserError


@dataclass(frozen=True)
class Vote:
    """The decision over all fragments of one sample, on the CPU.

    Attributes:
        label: Index of the predicted class.
        shares: (classes,) share of the fragments that voted for each class; they sum to 1.
        fragments: (fragments,) predicted class index of every fragment.
        probabilities: (classes,) float64, the mean class probabilities of the fragments, or the
            probabilities of their mean score, depending on the rule; they sum to 1.
        relative_macs: Computed multiply-accumulates as a share of those of all fragments.
        novelty: Novelty of the sample, at least 0; None if it is not known of all senses.
        modalities: Modalities that were used, if not all were; else empty.
        by_mean: Whether the probabilities decided, and not the shares.
    """

    label: int
    shares: Tensor
    fragments: Tensor
    probabilities: Tensor
    relative_macs: float = 1.0
    novelty: float | None = None
    modalities: tuple[str, ...] = ()
    by_mean: bool = False

    @property
    def support(self) -> Tensor:
        """The values (classes,) whose largest is the label: shares or probabilities."""
        return self.probabilities if self.by_mean else self.shares

    @property
    def probability(self) -> float:
        """Probability of the predicted class."""
        return float(self.probabilities[self.label])

    def deciding_by_mean(self) -> "Vote":
        """Return the vote of the same fragments by the largest probability."""
        return replace(self, label=int(self.probabilities.argmax()), by_mean=True)

    def with_novelty(self, novelty: Tensor) -> "Vote":
        """Return the vote with a novelty ()."""
        return replace(self, novelty=float(novelty))

    def doubted(self, share: float) -> "Vote":
        """Return the vote with a ``share`` of votes and probabilities spread over all classes."""
        even = share / len(self.shares)
        return replace(
            self,
            shares=self.shares * (1 - share) + even,
            probabilities=self.probabilities * (1 - share) + even,
        )


class Tally:
    """Sums over fragments that give their vote, so that fragments need not be kept.

    Args:
        classes: Number of classes.
        temperature: Logits are divided by it before they become probabilities.

    Attributes:
        votes: (classes,) int64, number of fragments whose most probable class it is.
        sums: (classes,) float64, sums of probabilities.
        scores: (classes,) float64, sums of logits.
    """

    def __init__(self, classes: int, temperature: float) -> None:
        self.temperature = temperature
        self.votes = torch.zeros(classes, dtype=torch.int64)
        self.sums, self.scores = torch.zeros(2, classes, dtype=torch.float64)

    @classmethod
    def of(cls, logits: Tensor, temperature: float) -> "Tally":
        """Return the tally of fragments (classes, fragments).

        Raises:
            UserError: If a score is NaN or infinite, which would win or lose every vote.
        """
        logits, tally = logits.detach().cpu(), cls(len(logits), temperature)
        tally.sums = probabilities(logits, temperature)
        tally.votes = torch.bincount(logits.argmax(dim=0), minlength=len(logits))
        tally.scores = logits.double().sum(dim=1)
        return tally

    def plus(self, logits: Tensor) -> "Tally":
        """Return the tally with further fragments (classes, fragments), see :meth:`of`."""
        return self.joined(Tally.of(logits, self.temperature))

    def joined(self, other: "Tally") -> "Tally":
        """Return the tally of the fragments of both."""
        total = Tally(len(self.votes), self.temperature)
        total.sums, total.votes = self.sums + other.sums, self.votes + other.votes
        total.scores = self.scores + other.scores
        return total

    def vote(self, fragments: Tensor | None = None) -> Vote:
        """Return the :func:`max_vote`; without ``fragments`` its fragments are sorted by class."""
        count, every = int(self.votes.sum()), np.arange(len(self.votes))
        label = int(np.lexsort((-every, self.sums, self.votes))[-1])
        if fragments is None:
            fragments = torch.repeat_interleave(self.votes)
        return Vote(label, self.votes / count, fragments, self.sums / count)

    def score_vote(self) -> Vote:
        """Return the :func:`score_vote`."""
        return by_score(self.vote(), self.scores / self.votes.sum() / self.temperature)


def max_vote(logits: Tensor, temperature: float = 1.0) -> Vote:
    """Count a vote of every fragment for its most probable class; most votes win.

    Ties are broken by the larger mean probability over all fragments, then by the lower class
    index. The order of the fragments never matters beyond rounding of that mean.

    Args:
        logits: (classes, fragments) on any device, at least one fragment.
        temperature: The logits are divided by it before they become probabilities.

    Raises:
        UserError: If a score is NaN or infinite, which would win or lose every vote.
    """
    logits = logits.detach().cpu()
    if logits.shape[1] == 0:
        raise ValueError("a vote needs at least one fragment")
    return Tally.of(logits, temperature).vote(logits.argmax(dim=0))


def mean_vote(logits: Tensor, temperature: float = 1.0) -> Vote:
    """Choose the class with the largest mean probability; otherwise as :func:`max_vote`.

    A fragment counts the more, the more confident it is.
    """
    return max_vote(logits, temperature).deciding_by_mean()


def score_vote(logits: Tensor, temperature: float = 1.0) -> Vote:
    """Choose the class with the largest mean score, the product rule of Kittler et al. (1998).

    The probabilities are those of the mean score.
    """
    logits = logits.cpu()
    vote, mean = max_vote(logits, temperature), logits.double().mean(dim=1)
    return by_score(vote, mean / temperature)


def by_score(vote: Vote, score: Tensor) -> Vote:
    """Decide by the mean score (classes,) of the fragments, divided by the temperature."""
    return replace(vote, probabilities=score.softmax(dim=0)).deciding_by_mean()


def probabilities(logits: Tensor, temperature: float = 1.0) -> Tensor:
    """Return the sums (classes,), in float64 on the CPU, of all fragments' class probabilities.

    Raises:
        UserError: If a score is NaN or infinite, which would win or lose every vote.
    """
    if not bool(logits.isfinite().all()):
        raise UserError(
            "The class scores of this sample are NaN or infinite, so there is no decision; leave "
            "it out, or correct the network or baseline that gives them."
        )
    return (logits.cpu().double() / temperature).softmax(dim=0).sum(dim=1)


def random_tuples(positions: Sequence[int], count: int, seed: int) -> Tensor:
    """Draw ``count`` tuples with a position of each sense, independently and uniformly.

    The generator lives on the CPU whatever the device, so every device votes over the same tuples.

    Args:
        positions: Number of positions of each sense: L of a trace, M * N of a photo.
        count: K of the paper, 1000 there.
        seed: Seed of this sample; the caller derives it from the sample's content.

    Returns:
        Long tensor (count, senses).
    """
    generator = torch.Generator().manual_seed(seed)
    drawn = [torch.randint(number, (count,), generator=generator) for number in positions]
    return torch.stack(drawn, dim=1)


@dataclass(frozen=True)
class Rule:
    """A decision rule: from the class scores of fragments to a vote.

    Attributes:
        decide: Makes a vote of logits (classes, fragments) and a temperature.
        of_tally: Makes the same vote of fragments that were added up.
        by_mean_score: Whether the mean score decides. Recordings are then always computed whole.
    """

    decide: Callable[[Tensor, float], Vote]
    of_tally: Callable[[Tally], Vote]
    by_mean_score: bool = False

    def __call__(self, logits: Tensor, temperature: float = 1.0) -> Vote:
        """Decide; the arguments are those of :func:`max_vote`."""
        return self.decide(logits, temperature)


RULES = {
    "vote": Rule(max_vote, Tally.vote),
    "mean": Rule(mean_vote, lambda tally: tally.vote().deciding_by_mean()),
    "score": Rule(score_vote, Tally.score_vote, by_mean_score=True),
}
