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
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier, class_scores
from tex_lightning.classifier.vote import RULES, Tally, Vote
from tex_lightning.core.devices import computing_threads, full_precision
from tex_lightning.inference.live_rests import LiveRests, MarkedSignal
from tex_lightning.networks.geometry import padded_positions, reach
from tex_lightning.networks.linear import LinearNet
from tex_lightning.senses.features.movement import (
    block_power,
    movement_start,
)
from tex_lightning.senses.features.proportions import BandProportions
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures
from tex_lightning.senses.octave_bands import OVERLAP, OctaveBands

EXACT_SECONDS, EXACT_SAMPLES = 3, 1000  # whichever is longer
PAUSE = 20  # times the seconds in which a gain is told: after a rest as long it is taken as it is
PER_OCTAVE = 4  # of power, in which fragments are told apart that may turn out to be rests


@dataclass
class Sums:
    """Sums over fragments.

    Attributes:
        tally: Sums of their votes, probabilities and scores.
        total: (D,) float64, sum of their embeddings.
        count: Number of fragments.
    """

    tally: Tally
    total: Tensor | float = 0.0
    count: int = 0

    def joined(self, other: "Sums") -> "Sums":
        """Return the sums of both."""
        return Sums(
            self.tally.joined(other.tally), self.total + other.total, self.count + other.count
        )


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
        network: Any = self.sense.network
        linear = isinstance(network, LinearNet) and network.scores.is_linear
        self.by_mean = linear and RULES[self.card.rule].by_mean_score  # one score decides
        self.count = 0  # of fragments that were added up
        self.sums: dict[float, Sums] = {}  # by quarter octaves of power, where rests are left out

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
        threads = self.classifier.threads(self.name, new)
        with computing_threads(threads), full_precision(new.device):
            return self._go_on(*self.rests.push(new, ahead))

    @abstractmethod
    def _go_on(self, settled: MarkedSignal, rest: MarkedSignal) -> Vote:
        """Return the vote after a further final stretch, and the preliminary one after it."""

    def _embedding(self, x: Tensor) -> Tensor:
        """Return the embedding (D, positions) of a network input."""
        return self.classifier.embedding_of_input(self.name, x)

    def _add(self, embedding: Tensor, key: float = math.inf) -> None:
        """Add fragments (D, positions) to the sums of their power, by which rests are told."""
        sums, _ = self._sums_of(embedding, self._added())
        self.sums[key] = self.sums[key].joined(sums) if key in self.sums else sums
        self.count += sums.count

    def _added(self) -> Sums:
        """Return the sums of all fragments that are no rests by the present limit of power."""
        sums = self._blank()
        for key, some in self.sums.items():
            sums = sums if self._is_rest(key) else sums.joined(some)
        return sums

    def _is_rest(self, key: float) -> bool:
        """Return whether fragments of some power in quarter octaves are a rest by now."""
        limit, *_ = self.rests.limits
        return limit > 0 and key + 1 <= PER_OCTAVE * math.log2(limit)

    def _blank(self) -> Sums:
        return Sums(Tally(len(self.card.classes), self.card.temperature))

    def _sums_of(self, embedding: Tensor, before: Sums) -> tuple[Sums, Tensor]:
        """Return the sums of further fragments (D, positions), and the mean (D,) of all."""
        sums = self._blank()
        sums.total, sums.count = embedding.cpu().double().sum(dim=1), embedding.shape[1]
        count = before.count + sums.count
        mean = ((before.total + sums.total) / count).to(embedding)
        sums.tally = sums.tally.plus(self._scores(embedding, (mean, count)))
        return sums, mean

    def _vote(self, embedding: Tensor) -> Vote:
        """Vote by all added fragments and further ones (D, positions), without adding these."""
        before = self._added()
        sums, mean = self._sums_of(embedding, before)
        every = before.joined(sums)
        if self.by_mean:  # with what is in range by now
            every.tally.scores = every.count / sums.count * sums.tally.scores
        known, vote = (
            self.classifier.statistics_of(self.name),
            RULES[self.card.rule].of_tally(every.tally),
        )
        return vote if known is None else vote.with_novelty(known.novelty(mean))

    def _scores(self, embedding: Tensor, whole: tuple[Tensor, int]) -> Tensor:
        """Return the class scores (classes, positions) of some fragments of the whole."""
        if self.layer == self.classifier.fused_layer(self.name):
            return embedding
        if self.by_mean:
            score = class_scores(self.sense.network, whole[0][:, None], whole)
            return score.expand(-1, embedding.shape[1])
        return class_scores(self.sense.network, embedding, whole)


class RunningSpectrogramVote(RunningVote):
    """The running vote of a network whose positions each see a window of a spectrogram.

    Attributes:
        samples: (axes, samples) that no frame was computed of yet.
        frames: Magnitudes (bands, frames) that positions still to come depend on.
        first: Number of the first of these frames.
        gains: Factors of magnitudes by the number of the frame from which on they hold, once these
            are final.
        heard: Magnitudes (bands,) that the first of them was told from.
        cut: Number of samples up to the end of the last movement.
    """

    features: SpectrogramFeatures

    def __init__(self, classifier: SurfaceClassifier) -> None:
        super().__init__(classifier)
        geometry = self.sense.geometry
        assert geometry is not None
        self.windows = geometry.layers[1]
        self.samples: Tensor | None = None
        self.frames: Tensor | None = None
        self.first = self.length = self.cut = 0
        self.gains: list[tuple[int, Tensor]] = []
        self.heard = torch.zeros(0)
        self.last: Vote | None = None

    def _go_on(self, settled: MarkedSignal, rest: MarkedSignal) -> Vote:
        moving = (~torch.cat((settled.left_out, rest.left_out))).nonzero()
        self.cut = self.length + int(moving[-1]) + 1 if len(moving) else self.cut
        self.length += settled.signal.shape[1]
        signals = settled.signal if self.samples is None else (self.samples, settled.signal)
        samples = torch.cat(signals, dim=1) if isinstance(signals, tuple) else signals
        frames = self._appended(self.frames, samples)
        done = self.features.frames(samples.shape[1])
        self.samples = samples[:, done * self.features.hop_length :].clone()
        every = self._appended(frames, torch.cat((self.samples, rest.signal), dim=1))
        return self._voted(frames, every)

    def _appended(self, frames: Tensor | None, samples: Tensor) -> Tensor:
        """Return frames (bands, frames) with those of further samples (axes, samples)."""
        known = samples.new_zeros(self.features.bands, 0) if frames is None else frames
        if not self.features.frames(samples.shape[1]):
            return known
        return torch.cat((known, self.features.spectra(samples)), dim=-1)

    def _voted(self, settled: Tensor, every: Tensor) -> Vote:
        """Vote by all frames up to the cut, and add the positions that see only final frames."""
        end, stride, added = self.features.frames(self.cut), self.sense.stride, self.count
        skip = added - self.first // stride
        embedding: Tensor | None = None
        gains, final = self._gains(every[:, : end - self.first], self.first + settled.shape[1])
        if not added or reach(self.windows, added) <= end:  # else the tool rests since then
            embedding = self._embedded(every[:, : end - self.first], gains)[:, skip:]
            self.last = self._vote(embedding)
        last = self.first + settled.shape[-1]
        count = (last - reach(self.windows, 1)) // stride + 1
        if final and count > added:
            if embedding is None or reach(self.windows, count) > end:
                embedding = self._embedded(settled, gains)[:, skip:]
            self._add(embedding[:, : count - added])
            first = max(0, count - padded_positions(self.windows)) * stride
            settled, self.first = settled[..., first - self.first :].clone(), first
        self.frames = settled
        assert self.last is not None
        return self.last

    def _gains(self, moved: Tensor, length: int) -> tuple[list[tuple[int, Tensor]], bool]:
        """Return the factors of frames, by the first that has each, and whether they are final.

        Args:
            moved: Magnitudes (bands, frames) up to the end of the movement.
            length: Number of all final frames; after a long rest they are taken as they are.
        """
        known, gains, end = self.features.known_gain, self.gains, self.first + moved.shape[1]
        if len(gains) == 2 or not known.in_use:
            return gains, True
        if not gains:
            self.heard = known.heard(moved)
            gains = [(0, known.gain(self.heard))]
        loud = known.after_rest(moved, self.heard)
        loud[: max(0, known.frames - self.first)] = False
        if loud.any():
            turn = loud.int().argmax()
            gains = [*gains, (self.first + int(turn), known.gain(known.heard_from(moved, turn)))]
        rested = length > end + PAUSE * known.frames
        if rested or end >= gains[-1][0] + known.frames:
            self.gains = gains
        return gains, len(gains) == len(self.gains)

    def _embedded(self, magnitudes: Tensor, gains: Sequence[tuple[int, Tensor]]) -> Tensor:
        """Return the embedding (D, positions) of magnitudes (bands, frames)."""
        factors = magnitudes.new_ones(magnitudes.shape[1])
        for begin, gain in gains:
            factors[max(0, begin - self.first) :] = gain
        return self._embedding(self.features.normalise(magnitudes * factors)[None, None])


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


def running_vote(classifier: SurfaceClassifier) -> RunningVote | None:
    """Return the running vote of a classifier; None if the whole signal has to be kept.

    That is the case for several senses, whose fragments are drawn at random, for baselines, for
    features that depend on the whole recording, and for features of a user.
    """
    if classifier.card.baseline or len(classifier.senses) > 1:
        return None
    (sense,) = classifier.senses.values()
    features, network = sense.features, sense.network
    if type(features) is BandProportions and type(network) is LinearNet:
        return RunningProportionsVote(classifier)
    by_frame = type(features) is SpectrogramFeatures and features.axes == "frame"
    if by_frame and features.normalisation == "standard" and sense.geometry is not None:
        return RunningSpectrogramVote(classifier)
    return None
