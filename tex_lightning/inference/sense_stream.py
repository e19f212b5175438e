"""The scores of a signal while it is recorded: what no later sample changes is computed once."""

import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SenseOutput, SurfaceClassifier
from tex_lightning.errors import UserError
from tex_lightning.networks.geometry import padded_positions, reach
from tex_lightning.senses.base import Sense
from tex_lightning.senses.features.spectrogram import (
    KNOWN_SECONDS,
    SpectrogramFeatures,
    movement_start,
)


class SenseStream:
    """Take the samples of one sense as they come; the output is that of the recording so far.

    Every frame is computed once. Positions whose receptive field has ended are settled; the network
    runs over the frames of the others alone.

    Args:
        classifier: In evaluation mode, with float32 weights.
        name: A sense whose features are local in time: spectrograms with ``axes=frame`` and
            ``normalisation=standard``.

    Attributes:
        frames: Spectrogram frames of the movement so far.
        output: Scores and novelty of all samples so far; None while there is no fragment.

    Raises:
        UserError: If the features need the whole recording, the geometry of the network is not
            known, or its weights are not float32.
    """

    def __init__(self, classifier: SurfaceClassifier, name: str) -> None:
        self.classifier, self.name = classifier, name
        self.sense = classifier.senses[name]
        self.features = _local_features(self.sense)
        self.layers = self.sense._known_geometry.layers[1]
        self.start_known = not self.features.skip_impact
        self.beginning: Tensor | None = None  # all samples, until it is known where to start
        self._start(0)

    def _start(self, ahead: int) -> None:
        """Forget everything; leave out the next ``ahead`` samples."""
        self.ahead, self.frames, self.settled = ahead, 0, 0
        self.rest: Tensor | None = None  # samples that later frames need
        self.tail: Tensor | None = None  # frames (bands, frames) that open positions need
        self.logits: Tensor | None = None  # (classes, positions) of settled positions
        self.embedding_sum: Tensor | float = 0.0  # (D,) over settled positions
        self.output: SenseOutput | None = None

    @torch.inference_mode()
    def push(self, samples: Tensor) -> None:
        """Take more samples (axes, samples) of any length, at the sampling rate of the sense."""
        samples = samples.to(self.features.window)
        if not self.start_known:
            samples = self._from_touch(samples)
        skipped = min(self.ahead, samples.shape[1])
        self.ahead -= skipped
        samples = _joined(self.rest, samples[:, skipped:])
        count = self.features.frames(samples.shape[1])
        self.rest = samples[:, count * self.features.hop_length :].clone()
        if count:
            self.frames += count
            frames = self.features.normalise(self.features.magnitudes(samples, 0))
            self.tail = _joined(self.tail, frames)
            self._score(self.tail)

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

    def _score(self, tail: Tensor) -> None:
        """Score the open positions, and settle those that have all their frames."""
        if self.frames < self.sense.min_size[1]:
            return
        before = min(self.settled, padded_positions(self.layers))  # that only lie in the padding
        level = self.classifier.embedding_layer(self.name)
        embedding = self.sense.dense_grid(tail[None, None], level).flatten(1)[:, before:]
        logits = self.classifier.output_of(self.name, embedding).partial_logits
        all_logits = _joined(self.logits, logits)
        self.output = SenseOutput(all_logits, self._novelty(embedding, all_logits.shape[1]))
        # positions that no later frame reaches
        settled = max(0, (self.frames - reach(self.layers, 0)) // self.sense.stride)
        self.embedding_sum += embedding[:, : settled - self.settled].sum(dim=1)
        self.logits = all_logits[:, :settled]
        kept = min(settled, padded_positions(self.layers))
        passed = (settled - kept) - (self.settled - before)
        self.tail = tail[:, passed * self.sense.stride :].clone()
        self.settled = settled

    def _novelty(self, embedding: Tensor, positions: int) -> Tensor | None:
        """Return the novelty of the recording so far; None without statistics."""
        statistics = self.classifier.statistics_of(self.name)
        if statistics is None:
            return None
        return statistics.novelty((self.embedding_sum + embedding.sum(dim=1)) / positions)


def is_local(sense: Sense) -> bool:
    """Whether a frame of a sense depends on its own samples, and a position on its own frames."""
    features = sense.features
    local = isinstance(features, SpectrogramFeatures) and (
        (features.axes, features.normalisation) == ("frame", "standard")
    )
    return local and sense.geometry is not None


def _local_features(sense: Sense) -> SpectrogramFeatures:
    """Return the features of a sense that can be computed before the end is known.

    Raises:
        UserError: Saying what it lacks.
    """
    if not isinstance(sense.features, SpectrogramFeatures) or not is_local(sense):
        raise UserError(
            f"The label of a whole recording so far takes a network of known geometry on "
            f"spectrograms with axes=frame and normalisation=standard, and {sense.name} has none; "
            "set stream.window=2 for a vote over the last seconds."
        )
    if any(parameter.dtype != torch.float32 for parameter in sense.network.parameters()):
        raise UserError(
            "A live stream is computed in float32, which alone gives the labels of the whole "
            "recording; set engine.precision=fp32."
        )
    return sense.features


def _joined(first: Tensor | None, second: Tensor) -> Tensor:
    return second if first is None else torch.cat((first, second), dim=1)
