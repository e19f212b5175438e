"""Update a vote with new samples of a signal, in time and memory that do not grow.

Samples, frames and fragments that cannot change any more are added up and dropped. The first
:data:`EXACT_SECONDS` are classified as a recording is. After that, a network on spectrograms gives
the vote of the recording so far, but for rounding. The vote by band proportions may differ a little
from it: fragments end at multiples of their length, and a rest or a knock is judged once, after
:data:`~.movement.REST_SECONDS`. Fragments that turn out to be rests, since louder movement follows,
are subtracted again.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import RULES, Tally, Vote
from tex_lightning.core.devices import computing_threads, full_precision
from tex_lightning.inference.live_rests import LiveRests, MarkedSignal
from tex_lightning.networks.line import scores_from_fc2
from tex_lightning.networks.linear import LinearNet
from tex_lightning.senses.features.movement import movement_start

EXACT_SECONDS, EXACT_SAMPLES = 3, 1000  # whichever is longer
PER_OCTAVE = 4  # of power, in which fragments are told apart that may turn out to be rests


@dataclass(frozen=True)
class Sums:
    """Sums over fragments.

    Attributes:
        tally: Sums of their votes, probabilities and scores.
        total: (D,) float64, sum of their embeddings.
    """

    tally: Tally
    total: Tensor | float

    def __add__(self, other: "Sums") -> "Sums":
        """Return the sums of both."""
        return Sums(self.tally + other.tally, self.total + other.total)

    @property
    def count(self) -> int:
        """Number of fragments."""
        return int(self.tally.votes.sum())


class RunningVote(ABC):
    """The vote of a classifier over a signal that goes on.

    Args:
        classifier: Classifier of a single sense.
    """

    features: Any

    def __init__(self, classifier: SurfaceClassifier) -> None:
        self.classifier, self.card = classifier, classifier.card
        ((self.name, self.sense),) = classifier.senses.items()
        self.features = self.sense.features
        self.layer = classifier.embedding_layer(self.name)
        rate, skip = self.features.sampling_rate, self.features.skip_impact
        self.exact = max(math.ceil(EXACT_SECONDS * rate), EXACT_SAMPLES)
        self.rests = LiveRests(rate, skip)
        self.beginning: Tensor | None = None
        self.began = False
        self.gain: Tensor | float = 1.0
        network: Any = self.sense.network
        linear = isinstance(network, LinearNet) and network.scores.is_linear
        self.by_mean = linear and RULES[self.card.rule].by_mean_score  # one score decides
        self.count = 0  # of fragments that were added up
        self.sums: dict[float, Sums] = {}  # by quarter octaves of power, where rests are left out
        nothing = torch.zeros(len(self.card.classes), 0)
        self.blank = Sums(Tally.of(nothing, self.card.temperature), 0.0)

    def push(self, new: Tensor, ahead: Tensor) -> Vote:
        """Return the vote over the signal so far.

        Args:
            new: Samples (axes, samples) at the rate of the sense.
            ahead: Preliminary samples after them; the next call replaces them.

        Raises:
            UserError: If there is no fragment yet.
        """
        new, ahead = new.to(self.classifier.device), ahead.to(self.classifier.device)
        if not self.began:
            whole = new if self.beginning is None else torch.cat((self.beginning, new), dim=1)
            if whole.shape[1] <= self.exact:
                self.beginning = whole
                recording = torch.cat((whole, ahead), dim=1)
                return self.classifier.classify(**{self.sense.modality: recording})
            rate = self.features.sampling_rate
            start = movement_start(whole, rate) if self.features.skip_impact else 0
            new, self.beginning, self.began = whole[:, start:], None, True
            self.gain = self._gain(whole)
        new, ahead = new * self.gain, ahead * self.gain
        threads = self.classifier.threads(self.name, new)
        with computing_threads(threads), full_precision(new.device):
            return self._go_on(*self.rests.push(new, ahead))

    def _gain(self, beginning: Tensor) -> Tensor | float:
        """Return by what the signal is multiplied, as its beginning (axes, samples) tells."""
        return 1.0

    @abstractmethod
    def _go_on(self, settled: MarkedSignal, rest: MarkedSignal) -> Vote:
        """Return the vote after a further final stretch, and the preliminary one after it."""

    def _embedding(self, x: Tensor) -> Tensor:
        """Return the embedding (D, positions) of a network input."""
        return self.classifier.embedding_of_input(self.name, x)

    def _add(self, embedding: Tensor, key: float = math.inf) -> None:
        """Add fragments (D, positions) to the sums of their power, by which rests are told."""
        sums, _ = self._sums_of(embedding, self._added())
        self.sums[key] = self.sums[key] + sums if key in self.sums else sums
        self.count += sums.count

    def _added(self) -> Sums:
        """Return the sums of all fragments that are no rests by the present limit of power."""
        moving = (sums for key, sums in self.sums.items() if not self._is_rest(key))
        return sum(moving, start=self.blank)

    def _is_rest(self, key: float) -> bool:
        """Return whether fragments of some power in quarter octaves are a rest by now."""
        limit, *_ = self.rests.limits
        return limit > 0 and key + 1 <= PER_OCTAVE * math.log2(limit)

    def _sums_of(self, embedding: Tensor, before: Sums) -> tuple[Sums, Tensor]:
        """Return the sums of further fragments (D, positions), and the mean (D,) of all."""
        total = embedding.cpu().double().sum(dim=1)
        count = before.count + embedding.shape[1]
        mean = ((before.total + total) / count).to(embedding)
        scores = self._scores(embedding, (mean, count))
        return Sums(Tally.of(scores, self.card.temperature), total), mean

    def _vote(self, embedding: Tensor) -> Vote:
        """Vote by all added fragments and further ones (D, positions), without adding these."""
        before = self._added()
        sums, mean = self._sums_of(embedding, before)
        tally = (before + sums).tally
        if self.by_mean:  # with what is in range by now
            share = int(tally.votes.sum()) / sums.count
            tally = replace(tally, scores=share * sums.tally.scores)
        known = self.classifier.statistics_of(self.name)
        vote = RULES[self.card.rule].of_tally(tally)
        return vote if known is None else vote.with_novelty(known.novelty(mean))

    def _scores(self, embedding: Tensor, whole: tuple[Tensor, int]) -> Tensor:
        """Return the class scores (classes, positions) of some fragments of the whole."""
        if self.layer == self.classifier.fused_layer(self.name):
            return embedding
        if self.by_mean:
            score = scores_from_fc2(self.sense.network, whole[0][:, None], whole)
            return score.expand(-1, embedding.shape[1])
        return scores_from_fc2(self.sense.network, embedding, whole)
