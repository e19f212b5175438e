"""Score recordings one by one and decide on them in any combination.

A FusionNet computes its summand of the class scores for each recording once, however many samples
it is part of, and decides as :meth:`SurfaceClassifier.classify` does.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier import SurfaceClassifier, content_seed
from tex_lightning.decision.voting import probabilities
from tex_lightning.errors import UserError
from tex_lightning.perturbations.pixels import Array


@dataclass(frozen=True)
class Scores:
    """Scores of one recording by one sense of a classifier.

    Attributes:
        recording: Signal or photo; a FusionNet draws its tuples by it.
        scores: Class scores (classes, positions) by this recording alone.
        summand: What it adds to those of a FusionNet; the same at level FC2.
    """

    recording: Array
    scores: Tensor
    summand: Tensor

    @property
    def belief(self) -> Tensor:
        """Mean class probabilities (classes,) by this recording alone, float64."""
        return probabilities(self.scores) / self.scores.shape[1]


@dataclass(frozen=True)
class Decision:
    """The decision on one sample.

    Attributes:
        label: Class index; None if the classifier refused the sample.
        share: Share of the votes.
        probability: Mean probability of the label over the fragments.
        agreement: Where several senses decided, the probability that draws from the beliefs of two
            of them are the same class, mean over all twos; else None.
    """

    label: int | None
    share: float = 0.0
    probability: float = 0.0
    agreement: float | None = None


REFUSED = Decision(None)


class Evaluator:
    """Decide by the scores of recordings.

    Args:
        classifier: In evaluation mode, as prediction runs it.

    Attributes:
        modalities: By the name of each sense, what it looks at.
    """

    def __init__(self, classifier: SurfaceClassifier) -> None:
        self.classifier = classifier
        self.classes = classifier.card.classes
        branches = classifier.card.branches
        self.modalities: dict[str, str] = {name: branches[name]["modality"] for name in branches}

    @torch.inference_mode()
    def score(self, recording: Array, sense: str) -> Scores | None:
        """Class scores of every position of a recording; None if it is refused."""
        try:
            features = self.classifier.positions(sense, torch.from_numpy(np.array(recording)))
        except UserError:
            return None
        summand = self.classifier.project(sense, features)
        scores = summand if self.classifier.level(sense) == "fc2" else features
        return Scores(recording, scores.cpu(), summand.cpu())

    @torch.inference_mode()
    def alone(self, scores: Scores | None) -> Decision:
        """Decide by one recording; so does a FusionNet whose other modalities are missing."""
        return REFUSED if scores is None else self._decide(scores.scores, 1)

    @torch.inference_mode()
    def together(self, scores: Mapping[str, Scores | None], count: int | None = None) -> Decision:
        """Decide by the recordings of some senses; those of the others are missing.

        Args:
            scores: By the name of each sense, in the order of the card.
            count: Number of tuples; None takes the card's.
        """
        found = {sense: each for sense, each in scores.items() if each is not None}
        if not found or len(found) < len(scores):
            return REFUSED
        if len(found) == 1:
            return self.alone(*found.values())
        # a modality that several senses look at counts once
        looked_at = {self.modalities[sense]: each.recording for sense, each in found.items()}
        seed = content_seed(self.classifier.card.decision["seed"], *looked_at.values())
        joined = self.classifier.join([each.summand for each in found.values()], seed, count)
        return self._decide(joined, len(found), _agreement(found.values()))

    def _decide(self, scores: Tensor, senses: int, agreement: float | None = None) -> Decision:
        card = self.classifier.card
        # some of the senses have no temperature of their own: `Card.of`
        temperature = card.temperature if senses == len(card.senses) else 1.0
        vote = self.classifier.decide(scores, temperature)
        return Decision(vote.label, float(vote.shares[vote.label]), vote.probability, agreement)


def _agreement(found: Iterable[Scores]) -> float:
    beliefs = [each.belief for each in found]
    return float(np.mean([float(one @ other) for one, other in combinations(beliefs, 2)]))
