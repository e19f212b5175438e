"""Decision rules: from the class scores of fragments to the label (paper, section III-B).

Votes are counted on the CPU in float64, so that every device decides alike on the same scores.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier.card import Card
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


@dataclass(frozen=True)
class Tally:
    """Sums over fragments, by which every rule decides, so that fragments need not be kept.

    Attributes:
        votes: (classes,) int64, number of fragments whose most probable class it is.
        sums: (classes,) float64, sums of probabilities.
        scores: (classes,) float64, sums of logits.
        temperature: Logits are divided by it before they become probabilities.
    """

    votes: Tensor
    sums: Tensor
    scores: Tensor
    temperature: float

    @classmethod
    def of(cls, logits: Tensor, temperature: float) -> "Tally":
        """Return the tally of fragments (classes, fragments) on any device.

        Raises:
            UserError: If a score is NaN or infinite, which would win or lose every vote.
        """
        logits = logits.detach().cpu()
        if not bool(logits.isfinite().all()):
            raise UserError(
                "The class scores of this sample are NaN or infinite, so there is no decision; "
                "leave it out, or correct the network or baseline that gives them."
            )
        votes, wide = logits.argmax(dim=0).bincount(minlength=len(logits)), logits.double()
        sums = (wide / temperature).softmax(dim=0).sum(dim=1)
        return cls(votes, sums, wide.sum(dim=1), temperature)

    def __add__(self, other: "Tally") -> "Tally":
        """Return the tally of the fragments of both."""
        sums = self.sums + other.sums, self.scores + other.scores
        return Tally(self.votes + other.votes, *sums, self.temperature)


def max_vote(tally: Tally) -> Vote:
    """Count a vote of every fragment for its most probable class; most votes win.

    Ties are broken by the larger mean probability over all fragments, then by the lower class
    index. The order of the fragments never matters beyond rounding of that mean. The fragments of
    the vote are sorted by class.
    """
    count, every = int(tally.votes.sum()), np.arange(len(tally.votes))
    label = int(np.lexsort((-every, tally.sums, tally.votes))[-1])
    fragments = torch.repeat_interleave(tally.votes)
    return Vote(label, tally.votes / count, fragments, tally.sums / count)


def mean_vote(tally: Tally) -> Vote:
    """Choose the class with the largest mean probability; otherwise as :func:`max_vote`.

    A fragment counts the more, the more confident it is.
    """
    vote = max_vote(tally)
    return replace(vote, label=int(vote.probabilities.argmax()), by_mean=True)


def score_vote(tally: Tally) -> Vote:
    """Choose the class with the largest mean score, the product rule of Kittler et al. (1998).

    The probabilities are those of the mean score.
    """
    probabilities = (tally.scores / tally.votes.sum() / tally.temperature).softmax(dim=0)
    label = int(probabilities.argmax())
    return replace(max_vote(tally), label=label, probabilities=probabilities, by_mean=True)


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
        of_tally: Makes a vote of fragments that were added up.
        by_mean_score: Whether the mean score decides. Recordings are then always computed whole.
    """

    of_tally: Callable[[Tally], Vote]
    by_mean_score: bool = False

    def __call__(self, logits: Tensor, temperature: float = 1.0) -> Vote:
        """Decide by fragments, whose order the vote keeps.

        Args:
            logits: (classes, fragments) on any device, at least one fragment.
            temperature: The logits are divided by it before they become probabilities.

        Raises:
            UserError: If a score is NaN or infinite, which would win or lose every vote.
        """
        logits = logits.detach().cpu()
        if logits.shape[1] == 0:
            raise ValueError("a vote needs at least one fragment")
        vote = self.of_tally(Tally.of(logits, temperature))
        return replace(vote, fragments=logits.argmax(dim=0))


RULES = {
    "vote": Rule(max_vote),
    "mean": Rule(mean_vote),
    "score": Rule(score_vote, by_mean_score=True),
}


class Decider(Protocol):
    """A decision on samples: by a network, by a baseline, or sequential.

    Attributes:
        card: Card of what computes the scores, with the rule that decides.
    """

    card: Card

    @property
    def device(self) -> torch.device:
        """Where it computes."""

    def classify(self, **recordings: Tensor) -> Vote:
        """Decide on one sample of decoded recordings by modality.

        Raises:
            UserError: If a modality that it needs is absent, or a recording is too small.
        """
