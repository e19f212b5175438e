"""A HapticNet that classifies while the tool is still moving."""

from typing import Any

import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.early_stopping import StoppingRule
from tex_lightning.classifier.vote import Vote, check_finite, probabilities, winner
from tex_lightning.errors import UserError
from tex_lightning.inference.stream_layers import Columns, streaming_layers
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.senses.features.spectrogram import (
    KNOWN_SECONDS,
    SpectrogramFeatures,
    movement_start,
)
from tex_lightning.senses.signal import SignalSense

MIN_ROOM = 1000  # labels
PIECE_SECONDS = 1.0  # longer chunks are taken in pieces, so that memory stays bounded


class StreamingClassifier:
    """Take samples as they come; the label is always that of the whole recording so far.

    Each frame, and each column of every layer that cannot change any more, is computed once. What
    the right edge decides is computed after every push from the few columns that reach it.

    Args:
        classifier: A HapticNet classifier in evaluation mode whose features are local in time:
            ``axes=frame`` and ``normalisation=standard``.
        wait: Most seconds of signal that are left uncomputed while they cannot change the label,
            whatever they hold; 0 computes everything at once.
        keep_scores: Whether :attr:`scores` can be asked for; they grow with the recording.

    Attributes:
        frames: Spectrogram frames of the movement so far.
        votes: (classes,) fragments that cannot change any more, by class.
        waiting: (axes, samples) that are not computed, or None.

    Raises:
        UserError: If the classifier is of another kind, or its features need the whole trace.
    """

    waiting: Tensor | None

    def __init__(
        self, classifier: SurfaceClassifier, *, wait: float = 0, keep_scores: bool = False
    ) -> None:
        sense: Any = next(iter(classifier.senses.values()))
        network, features = sense.network, sense.features
        if len(classifier.card.sense_names) > 1 or not isinstance(network, HapticNet):
            raise UserError(
                f"This checkpoint holds a {classifier.card.title}, and a live stream is "
                "classified by HapticNet; give the checkpoint of a run with model=haptic or "
                "model=sound, or set stream.window=2 for a vote over the last seconds."
            )
        if not isinstance(features, SpectrogramFeatures):
            raise UserError(
                f"A live stream takes spectrograms, and the features of {sense.name} are "
                f"{type(features).__name__}; set stream.window=2 for a vote over the last seconds."
            )
        self.sense: SignalSense = sense
        _check_local(features, network)
        self.features = features
        self.keep_scores = keep_scores
        self.hidden = streaming_layers([network.trunk, network.head.hidden])
        self.scoring = streaming_layers([network.head.scores])
        self.layers = [*self.hidden, *self.scoring]
        self.statistics = classifier.statistics_of(sense.name)
        self.known = int(KNOWN_SECONDS * features.sampling_rate)
        self.piece = int(PIECE_SECONDS * features.sampling_rate)
        self.wait = wait * features.sampling_rate
        self.output_size = network.output_size
        self.temperature = classifier.card.temperature
        self.by_mean = classifier.card.rule == "mean"
        self.exact = StoppingRule(0, network.classes)  # what follows in time is no random draw
        self.votes = torch.zeros(network.classes, dtype=torch.long)
        self.restart(start_known=not features.skip_impact)

    def restart(self, *, start_known: bool) -> None:
        """Begin another recording; with ``start_known`` it begins with steady movement."""
        self.start_known = start_known
        self.beginning: Tensor | None = None  # all samples, until it is known where to start
        self._start(0)

    @property
    def macs(self) -> int:
        """Multiply-accumulates of the network for this recording so far."""
        return sum(layer.macs for layer in self.layers)

    @property
    def scores(self) -> Tensor:
        """Class scores (classes, fragments) of everything so far, once there is a vote."""
        return torch.cat([*self.settled, self.edge], dim=1)

    @property
    def novelty(self) -> Tensor | None:
        """Novelty of the recording so far; None without a vote or statistics."""
        if self.statistics is None or self.vote is None:
            return None
        return self.statistics.novelty(self.sums / len(self.vote.fragments))

    @torch.inference_mode()
    def push(self, chunk: Tensor) -> Vote | None:
        """Take more samples and vote over everything so far.

        Args:
            chunk: (axes, samples) of any length, 0 included, at the checkpoint's sampling rate;
                as many axes as before.

        Returns:
            The vote of all samples so far; None while they do not give one fragment. Where some
            wait, the label is that of all, and the rest is of those that were computed. Its
            fragments are good until the next push, which may change the last of them.
        """
        samples = _joined(self.waiting, chunk.to(self.features.window))
        if self._can_wait(samples):
            self.waiting = samples
            return self.vote
        return self._compute(samples)

    @torch.inference_mode()
    def finish(self) -> Vote | None:
        """Compute what waits, so that the whole vote is that of all samples so far."""
        return self.vote if self.waiting is None else self._compute(self.waiting)

    def _can_wait(self, samples: Tensor) -> bool:
        """Whether the label is certain without these samples, and they are not too many."""
        if not self.start_known or self.vote is None or samples.shape[1] >= self.wait:
            return False
        known = 0 if self.rest is None else self.rest.shape[1]
        return self.certain(self.frames + self.features.frames(known + samples.shape[1]))

    def certain(self, frames: int) -> bool:
        """Whether the settled fragments decide for a recording of so many frames, all in all."""
        unsettled = self.output_size(self.features.bands, frames)[1] - int(self.votes.sum())
        sums = self.probabilities if self.by_mean else self.votes
        return self.exact.decided(sums.tolist(), unsettled)

    def _compute(self, samples: Tensor) -> Vote | None:
        """Vote over everything, these samples included."""
        self.waiting = None
        if not self.start_known:
            samples = self._from_touch(samples)
        skipped = min(self.ahead, samples.shape[1])
        self.ahead -= skipped
        for piece in torch.split(samples[:, skipped:], self.piece, dim=1):
            self._take(piece)
        return self.vote

    def _from_touch(self, samples: Tensor) -> Tensor:
        """Start anew when a touch shows that all before was not yet movement."""
        so_far = _joined(self.beginning, samples)
        start = movement_start(so_far, self.features.sampling_rate)
        self.start_known = start > 0 or so_far.shape[1] >= self.known
        self.beginning = None if self.start_known else so_far
        if start == 0:
            return samples
        self._start(start)
        return so_far

    def _start(self, ahead: int) -> None:
        """Forget everything; leave out the next ``ahead`` samples."""
        self.ahead = ahead
        self.waiting = None
        self.rest: Tensor | None = None  # samples that later frames need
        self.frames = 0
        for layer in self.layers:
            layer.restart()
        self.votes.zero_()
        self.probabilities = torch.zeros_like(self.votes, dtype=torch.float64)
        self.labels = self.votes.new_empty(MIN_ROOM)  # of fragments, with room for more
        self.settled_count = 0  # of them
        self.settled: list[Tensor] = []
        self.edge = self.probabilities.new_empty(len(self.votes), 0)
        self.settled_sums = self.sums = self.features.window.new_zeros(())  # of FC2's features
        self.vote: Vote | None = None

    def _take(self, piece: Tensor) -> None:
        """Compute what the samples settle."""
        features = self.features
        samples = _joined(self.rest, piece)
        count = features.frames(samples.shape[1])
        self.rest = samples[:, count * features.hop_length :]
        if not count:
            return
        self.frames += count
        columns: Columns = features.normalise(features.spectra(samples)).T[:, :, None]
        settled = count
        for layer in self.hidden:
            columns, settled = layer.push(columns, settled)
        if columns is not None and self.statistics is not None:
            self.sums = self.settled_sums + columns[:, 0].sum(dim=0)
            self.settled_sums = self.settled_sums + columns[:settled, 0].sum(dim=0)
        for layer in self.scoring:
            columns, settled = layer.push(columns, settled)
        if columns is not None:
            self.vote = self._count(columns[:, 0].T, settled)

    def _count(self, scores: Tensor, settled: int) -> Vote:
        """Keep the votes of settled fragments, and vote with those at the edge.

        Args:
            scores: (classes, fragments), those settled before left out.
            settled: The first so many of them are settled now.

        Raises:
            UserError: If a score is NaN or infinite.
        """
        check_finite(scores)
        labels = scores.argmax(dim=0).cpu()  # where votes are, see decision.voting
        fragments = self._noted(labels)
        votes, sums = self.votes, self.probabilities
        if settled:
            self.settled_count += settled
            votes += self._votes(labels[:settled])
            sums += probabilities(scores[:, :settled], self.temperature)
        if self.keep_scores:
            self.settled.append(scores[:, :settled])
            self.edge = scores[:, settled:]
        if settled < labels.shape[0]:
            votes = votes + self._votes(labels[settled:])
            sums = sums + probabilities(scores[:, settled:], self.temperature)
        count = fragments.shape[0]
        vote = Vote(winner(votes, lambda: sums), votes / count, fragments, sums / count)
        return vote.by_mean() if self.by_mean else vote

    def _noted(self, labels: Tensor) -> Tensor:
        """Labels of all fragments so far, these last; after hours a copy would cost too much."""
        count = self.settled_count + len(labels)
        if count > len(self.labels):
            grown = self.labels.new_empty(2 * count)
            grown[: self.settled_count] = self.labels[: self.settled_count]
            self.labels = grown
        self.labels[self.settled_count : count] = labels
        return self.labels[:count]

    def _votes(self, labels: Tensor) -> Tensor:
        return torch.bincount(labels, minlength=self.votes.shape[0])


def _check_local(features: SpectrogramFeatures, network: HapticNet) -> None:
    """Refuse what cannot be computed, or not to the same labels, before the end is known."""
    if features.axes != "frame" or features.normalisation != "standard":
        raise UserError(
            f"This checkpoint was trained with axes={features.axes} and "
            f"normalisation={features.normalisation}, which look at the whole recording; "
            "for a live stream train with axes=frame and normalisation=standard, or set "
            "stream.window=2 for a vote over the last seconds."
        )
    if any(parameter.dtype != torch.float32 for parameter in network.parameters()):
        raise UserError(
            "A live stream is computed in float32, which alone gives the labels of the whole "
            "recording; set engine.precision=fp32."
        )


def _joined(first: Tensor | None, second: Tensor) -> Tensor:
    return second if first is None else torch.cat((first, second), dim=1)
