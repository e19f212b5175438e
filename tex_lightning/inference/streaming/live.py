"""A recording that goes on, as a person follows it: samples in, predictions out."""

import time
from typing import Any

import numpy as np
import torch

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.data.arrays import as_trace
from tex_lightning.data.quality import Quality, TraceMonitor
from tex_lightning.decision.voting import Vote
from tex_lightning.devices import synchronise
from tex_lightning.errors import UserError
from tex_lightning.inference.streaming.classifier import StreamingClassifier
from tex_lightning.prediction import Prediction, describe


class LiveStream:
    """Take samples as they come and predict from all of them so far.

    Args:
        classifier: Accelerated; see :class:`StreamingClassifier` for what it has to be.
        wait: Most seconds of signal that are left uncomputed while they cannot change the label.
        top_k: How many classes a prediction lists.

    Attributes:
        rate: In Hz, that samples must have.

    Raises:
        UserError: If the classifier cannot be streamed, or is to reject while samples wait.
    """

    def __init__(self, classifier: SurfaceClassifier, *, wait: float, top_k: int) -> None:
        self.card = classifier.card
        if self.card.baseline:
            raise UserError(
                f"This checkpoint holds {self.card.title}, and a live stream is classified by "
                "HapticNet; give the checkpoint of a run with model=haptic or model=sound."
            )
        if wait > 0 and self.card.reject_below:
            raise UserError(
                "decision.reject_below needs the probability after every chunk, and with "
                "stream.wait it is left behind: set stream.wait=0, or decision.reject_below=0."
            )
        self.device, self.top_k = classifier.device, top_k
        self.classifier = StreamingClassifier(classifier, wait=wait)
        self.monitor = TraceMonitor(self.classifier.branch.what)
        self.axes: int | None = None  # not known yet
        self.rate = self.classifier.features.sampling_rate

    @property
    def waiting(self) -> bool:
        """Whether samples were left uncomputed, which :meth:`finish` computes."""
        return self.classifier.waiting is not None

    def push(self, samples: Any) -> Prediction:  # noqa: ANN401  (what NumPy can read)
        """Take more samples and predict from all so far.

        Args:
            samples: (samples,) or (axes, samples) at :attr:`rate`, in the unit of the training; as
                many axes as before.

        Returns:
            A prediction without a label while there is not one fragment.

        Raises:
            UserError: If they are no such samples.
        """
        begin = time.perf_counter()
        chunk = as_trace(samples, self.classifier.branch.modality)
        axes, shape = self.axes or len(chunk), tuple(np.shape(samples))
        if shape != (axes, chunk.size // axes) and not (axes == len(shape) == 1):
            raise UserError(
                f"A chunk has the shape {shape}; give (axes, samples) with as many axes as before, "
                f"{axes}."
            )
        self.axes = axes
        self.monitor.update(chunk)
        return self._describe(self.classifier.push(torch.from_numpy(chunk).float()), begin)

    def finish(self) -> Prediction:
        """Compute what waits, so that the prediction is that of all samples so far."""
        begin = time.perf_counter()
        return self._describe(self.classifier.finish(), begin)

    def check(self) -> None:
        """Make sure that there was a fragment.

        Raises:
            UserError: Saying how much signal it takes.
        """
        self.classifier.branch.check_frames(self.classifier.frames)

    def _describe(self, vote: Vote | None, begin: float) -> Prediction:
        quality = Quality()
        if self.monitor.count:
            ranges = self.card.input_ranges.get(self.classifier.branch.modality, {})
            quality = self.monitor.quality(ranges, level=self.monitor.level)
        synchronise(self.device)
        return describe(vote, self.card, quality, self.top_k, time.perf_counter() - begin)
