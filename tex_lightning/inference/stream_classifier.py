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

PIECE_SECONDS = 1.0  # longer chunks are taken in pieces, so that memory stays bounded


class StreamingClassifier:
    """Take samples as they come; the label is always that of the whole recording so far.

    Each frame, and each column of every layer that cannot change any more, is computed once. What
    the right edge decides is computed after every push from the few columns that reach it.

    Args:
        classifier: A HapticNet classifier in evaluation mode whose features are local in time:
            ``axes=frame`` and ``normalisation=standard``.
        keep_scores: Whether :attr:`scores` can be asked for; they grow with the recording.

    Attributes:
        frames: Spectrogram frames of the movement so far.
        votes: (classes,) fragments that cannot change any more, by class.
        vote: The last one; None while there is no fragment.

    Raises:
        UserError: If the classifier is of another kind, or its features need the whole trace.
    """

    def __init__(self, classifier: SurfaceClassifier, *, keep_scores: bool = False) -> None:
        self.sense = _local_sense(classifier)
        network: Any = self.sense.network
        features: Any = self.sense.features
        self.features: SpectrogramFeatures = features
        self.keep_scores = keep_scores
        self.hidden = streaming_layers([network.trunk, network.head.hidden])
        self.scoring = streaming_layers([network.head.scores])
        self.layers = [*self.hidden, *self.scoring]
        self.statistics = classifier.statistics_of(self.sense.name)
        self.output_size = network.output_size
        self.temperature = classifier.card.temperature
        self.by_mean = classifier.card.rule == "mean"
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
            The vote of all samples so far; None while they do not give one fragment.
        """
        samples = chunk.to(self.features.window)
        if not self.start_known:
            samples = self._from_touch(samples)
        skipped = min(self.ahead, samples.shape[1])
        self.ahead -= skipped
        piece = int(PIECE_SECONDS * self.features.sampling_rate)
        for part in torch.split(samples[:, skipped:], piece, dim=1):
            self._take(part)
        return self.vote

    def certain(self, frames: int) -> bool:
        """Whether the settled votes decide for a recording of so many frames, all in all."""
        unsettled = self.output_size(self.features.bands, frames)[1] - int(self.votes.sum())
        # what follows in time is no random draw
        return StoppingRule(0, len(self.votes)).decided(self.votes.tolist(), unsettled)

    def _from_touch(self, samples: Tensor) -> Tensor:
        """Start anew when a touch shows that all before was not yet movement."""
        so_far, rate = _joined(self.beginning, samples), self.features.sampling_rate
        start = movement_start(so_far, rate)
        self.start_known = start > 0 or so_far.shape[1] >= int(KNOWN_SECONDS * rate)
        self.beginning = None if self.start_known else so_far
        if start == 0:
            return samples
        self._start(start)
        return so_far

    def _start(self, ahead: int) -> None:
        """Forget everything; leave out the next ``ahead`` samples."""
        self.ahead = ahead
        self.rest: Tensor | None = None  # samples that later frames need
        self.frames = 0
        for layer in self.layers:
            layer.restart()
        self.votes.zero_()
        self.probabilities = torch.zeros_like(self.votes, dtype=torch.float64)
        self.labels = self.votes.new_empty(0)  # of settled fragments
        self.settled: list[Tensor] = []
        self.edge = self.probabilities.new_empty(len(self.votes), 0)
        self.settled_sums = self.sums = self.features.window.new_zeros(())  # of FC2's features
        self.vote: Vote | None = None

    def _take(self, piece: Tensor) -> None:
        """Compute what the samples settle."""
        features, samples = self.features, _joined(self.rest, piece)
        count = settled = features.frames(samples.shape[1])
        self.rest = samples[:, count * features.hop_length :]
        if not count:
            return
        self.frames += count
        columns: Columns = features.normalise(features.spectra(samples)).T[:, :, None]
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
        fragments = torch.cat((self.labels, labels))
        self.labels = fragments[: len(self.labels) + settled]
        self.votes += self._votes(labels[:settled])
        self.probabilities += probabilities(scores[:, :settled], self.temperature)
        if self.keep_scores:
            self.settled.append(scores[:, :settled])
            self.edge = scores[:, settled:]
        votes = self.votes + self._votes(labels[settled:])
        sums = self.probabilities + probabilities(scores[:, settled:], self.temperature)
        count = len(fragments)
        vote = Vote(winner(votes, lambda: sums), votes / count, fragments, sums / count)
        return vote.by_mean() if self.by_mean else vote

    def _votes(self, labels: Tensor) -> Tensor:
        return torch.bincount(labels, minlength=len(self.votes))


def _local_sense(classifier: SurfaceClassifier) -> SignalSense:
    """The only sense, if it can be computed to the same labels before the end is known.

    Raises:
        UserError: Saying what it lacks.
    """
    sense: Any = next(iter(classifier.senses.values()))
    network, features = sense.network, sense.features
    if (
        len(classifier.card.sense_names) > 1
        or not isinstance(network, HapticNet)
        or not isinstance(features, SpectrogramFeatures)
        or (features.axes, features.normalisation) != ("frame", "standard")
    ):
        raise UserError(
            f"The label of a whole recording so far takes HapticNet on spectrograms with axes=frame"
            f" and normalisation=standard, and this is another {classifier.card.title}; set "
            "stream.window=2 for a vote over the last seconds."
        )
    if any(parameter.dtype != torch.float32 for parameter in network.parameters()):
        raise UserError(
            "A live stream is computed in float32, which alone gives the labels of the whole "
            "recording; set engine.precision=fp32."
        )
    found: SignalSense = sense
    return found


def _joined(first: Tensor | None, second: Tensor) -> Tensor:
    return second if first is None else torch.cat((first, second), dim=1)
