"""The running vote by band proportions, fragment after fragment."""

import math

import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import Vote
from tex_lightning.inference.live_rests import MarkedSignal
from tex_lightning.inference.running_vote import PER_OCTAVE, RunningVote
from tex_lightning.senses.features.movement import block_power
from tex_lightning.senses.features.octave_bands import OVERLAP
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
        return self.features.gain(beginning)

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
            return self._vote(self._all_fragments(movement, mean))
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
            self._add(self._next_fragment(kept, mean), self._power(kept))
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

    def _next_fragment(self, kept: Tensor, mean: Tensor) -> Tensor:
        """Return the embedding (D, 1) of the next fragment of :attr:`kept`."""
        ends = [(self._frame(x.hop, 1) - 1) * x.hop + x.length for x in self.features.used]
        signals = [kept[:, : end - self.first] for end in ends]
        return self._fragments(signals, kept[:, : self._frame(1, 1) - self.first], mean, 1)

    def _all_fragments(self, movement: Tensor, mean: Tensor) -> Tensor:
        """Return the embedding (D, fragments) of all that is left of a movement."""
        samples = self.first + movement.shape[1]
        most = self.features.longest.count_frames(samples)
        count = max(1, min(most, self.features.count_fragments(samples)) - self.count)
        return self._fragments([movement] * len(self.features.used), movement, mean, count)

    def _fragments(
        self, signals: list[Tensor], movement: Tensor, mean: Tensor, count: int
    ) -> Tensor:
        """Return the embedding (D, count) of equal fragments from the next one on.

        Args:
            signals: For each window in use (axes, samples) from :attr:`first` to its last frame.
            movement: (axes, samples) from :attr:`first` to the last fragment's end.
            mean: (axes, 1) of the movement so far.
            count: Number of fragments.
        """
        used = self.features.used
        frames = [
            window.count_frames(self.first + signal.shape[1]) - self._frame(window.hop)
            for window, signal in zip(used, signals, strict=True)
        ]
        distinct = min(*frames, count)
        summaries = []
        for window, signal, length in zip(used, signals, frames, strict=True):
            first = self._frame(window.hop)
            before = max(0, first - OVERLAP)
            x = signal[:, before * window.hop - self.first :]
            blocks = window.in_blocks(x, self.features.level, first - before)
            summaries.append(window.summary(blocks, length, distinct))
        samples = movement[:, self._frame(1) - self.first :]
        embedding = self._embedding(self.features.join(summaries, samples, distinct, mean))
        numbers = torch.arange(count, device=embedding.device)
        return embedding[:, numbers * distinct // count]
