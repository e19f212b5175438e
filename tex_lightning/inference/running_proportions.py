"""The running vote by band proportions, fragment after fragment."""

import math

import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import Vote
from tex_lightning.inference.live_rests import MarkedSignal
from tex_lightning.inference.running_vote import PER_OCTAVE, RunningVote
from tex_lightning.senses.features.movement import block_power
from tex_lightning.senses.features.octave_bands import OVERLAP, OctaveBands
from tex_lightning.senses.features.proportions import BandProportions


class RunningProportionsVote(RunningVote):
    """The running vote of band proportions and a linear network.

    Attributes:
        kept: Final movement (axes, samples) that fragments still to come depend on.
        first: Number of its first sample.
        sum: (axes, 1), sum of all samples of the final movement.
    """

    features: BandProportions

    def __init__(self, classifier: SurfaceClassifier) -> None:
        super().__init__(classifier)
        features = self.features
        self.hops = [window.hop for window in features.used]
        self.size = max(features.fragment_seconds * features.sampling_rate, *self.hops)
        self.kept: Tensor | None = None
        self.first, self.sum = 0, torch.zeros(())

    def _gain(self, beginning: Tensor) -> Tensor | float:
        return self.features.gravity.gain(beginning)

    def _go_on(self, settled: MarkedSignal, rest: MarkedSignal) -> Vote:
        more, ahead = settled.movement, rest.movement
        self.kept = more if self.kept is None else torch.cat((self.kept, more), dim=1)
        self.sum = self.sum.cpu() + more.cpu().double().sum(dim=1, keepdim=True)
        if self.sums and self._is_rest(max(self.sums)):
            self._begin_again(self.kept)
        self._add_fragments(self.kept)
        movement = torch.cat((self.kept, ahead), dim=1)
        if self.count:
            total = self.sum + ahead.cpu().double().sum(dim=1, keepdim=True)
            mean = (total / (self.first + movement.shape[1])).to(movement)
            return self._vote(self._part(movement, mean))
        self.features.check_length(movement)
        return self._vote(self._embedding(self.features.describe(movement)))

    def _begin_again(self, kept: Tensor) -> None:
        """Forget all fragments, which were a rest before the tool moved, and what is left of it."""
        self.kept = kept[:, ~self.rests.judged_again(kept)]
        self.sum = self.kept.cpu().double().sum(dim=1, keepdim=True)
        self.first, self.count, self.sums = 0, 0, {}

    def _add_fragments(self, kept: Tensor) -> None:
        """Add all fragments but the last ones, and drop samples that no later one depends on."""
        length = self.first + kept.shape[1]
        mean = (self.sum / length).to(kept) if length else self.sum
        longest = self.features.longest.length
        least = max(self.size, longest) + max(self.hops)  # has a frame of every window
        while (self.count + 1) * self.size + least <= length:
            self._add(self._part(kept, mean, whole=False), self._power(kept))
        needed = min(hop * max(0, self._frame(hop) - OVERLAP) for hop in self.hops)
        self.kept, self.first = kept[:, needed - self.first :].clone(), needed

    def _power(self, kept: Tensor) -> float:
        """Return the largest power of a block in the next fragment, in quarter octaves."""
        if self.rests.length is None:
            return math.inf
        first, last = (self._frame(1, more) - self.first for more in (0, 1))
        power = float(block_power(kept[:, first:last], self.rests.length).max())
        return math.floor(PER_OCTAVE * math.log2(power)) if power else -math.inf

    def _frame(self, hop: int, more: int = 0) -> int:
        """Return the first frame of the next fragment, or of one ``more`` after it."""
        return math.ceil((self.count + more) * self.size / hop)

    def _part(self, movement: Tensor, mean: Tensor, *, whole: bool = True) -> Tensor:
        """Return the features (D, fragments) of the next fragment, or of the whole movement left.

        Args:
            movement: (axes, samples), as :attr:`kept` and what comes after.
            mean: (axes, 1) of the movement so far.
            whole: Whether everything left is meant.
        """
        parts: list[tuple[OctaveBands, Tensor, int]] = []
        for window in self.features.used:
            first, last = self._frame(window.hop), self._frame(window.hop, 1)
            before = max(0, first - OVERLAP)
            end = None if whole else (last - 1) * window.hop + window.length - self.first
            x = movement[:, before * window.hop - self.first : end]
            parts.append((window, x, first - before))
        frames = [window.count_frames(x.shape[1]) - skip for window, x, skip in parts]
        remaining = self._left(self.first + movement.shape[1]) if whole else 1
        fragments = min(*frames, remaining)
        summaries = [
            window.summary(window.in_blocks(x, self.features.level, skip), count, fragments)
            for (window, x, skip), count in zip(parts, frames, strict=True)
        ]
        first, last = (self._frame(1, more) - self.first for more in (0, 1))
        samples = movement[:, first : None if whole else last]
        embedding = self._embedding(self.features.join(summaries, samples, fragments, mean))
        numbers = torch.arange(remaining, device=embedding.device)
        return embedding[:, numbers * fragments // remaining]

    def _left(self, samples: int) -> int:
        """Return how many more fragments a movement of so many samples is to have."""
        most = self.features.longest.count_frames(samples)
        return max(1, min(most, self.features.count_fragments(samples)) - self.count)
