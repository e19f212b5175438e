"""A live recording: samples in, predictions out."""

import logging
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from tex_lightning.classifier import Sensed, SurfaceClassifier
from tex_lightning.config import StreamConfig
from tex_lightning.data.quality import Quality, together
from tex_lightning.decision.voting import Vote
from tex_lightning.devices import synchronise
from tex_lightning.errors import UserError
from tex_lightning.inference.streaming.signal import LiveSignal
from tex_lightning.inference.streaming.whole import WholeVote
from tex_lightning.inference.streaming.window import WindowVote
from tex_lightning.prediction import Prediction, describe

log = logging.getLogger(__name__)


class LiveStream:
    """Take samples as they come and predict from all of them so far, or from the last seconds.

    Args:
        classifier: The accelerated classifier of the given senses.
        rates: Sampling rate in Hz by modality of each signal; None is the checkpoint's.
        photos: Decoded, by modality, with what is wrong with them; they stay as they are.
        config: Window and waiting.
        top_k: How many classes a prediction lists.

    Attributes:
        signals: The signals by modality, with their ``rate``.

    Raises:
        UserError: If the classifier cannot be streamed, or is to reject while samples wait.
    """

    def __init__(
        self,
        classifier: SurfaceClassifier,
        rates: Mapping[str, float | None],
        photos: Mapping[str, tuple[Tensor, Quality]],
        config: StreamConfig,
        top_k: int,
    ) -> None:
        self.card = classifier.card
        for key in ("reject_below", "unknown"):
            if config.wait > 0 and getattr(self.card, key):
                raise UserError(
                    f"decision.{key} is looked at after every chunk, and with stream.wait what it "
                    f"needs is left behind: set stream.wait=0, or decision.{key}=0."
                )
        self.device, self.top_k = classifier.device, top_k
        branches: dict[str, Any] = {each.modality: each for each in classifier.branches.values()}
        self.signals = {
            name: LiveSignal(branches[name], rate, self.card.input_ranges.get(name, {}))
            for name, rate in rates.items()
        }
        self.photo_quality = [quality for _, quality in photos.values()]
        fixed = _senses(classifier, {name: photo for name, (photo, _) in photos.items()})
        self.classifier: WholeVote | WindowVote
        if config.window is None:
            self.classifier = WholeVote(classifier, fixed, config.wait)
        else:
            self.classifier = WindowVote(classifier, fixed, config)
            if self.card.unknown_above is not None:
                log.warning(
                    "decision.unknown=%g is the rate of whole recordings; %g s say less, and more "
                    "of them are called unknown.",
                    self.card.unknown, config.window,
                )  # fmt: skip

    @property
    def rate(self) -> float:
        """Sampling rate in Hz that samples must have; with several signals, of the first."""
        return next(iter(self.signals.values())).rate

    @property
    def waiting(self) -> bool:
        """Whether samples were left uncomputed, which :meth:`finish` computes."""
        held = self.classifier.contact is None and any(
            signal.resampler is not None for signal in self.signals.values()
        )
        return self.classifier.waiting or held

    def push(self, samples: Any = None, /, **chunks: Any) -> Prediction:  # noqa: ANN401  (what NumPy can read)
        """Take more samples and predict.

        Args:
            samples: (samples,) or (axes, samples) at :attr:`rate`, in the unit of the training; as
                many axes as before.
            **chunks: The same by modality, of several signals as many seconds each.

        Returns:
            A prediction, without a label while there is no fragment yet or nothing is touched.

        Raises:
            UserError: If they are no such samples.
        """
        begin = time.perf_counter()
        if samples is not None and len(self.signals) == 1:
            chunks = dict.fromkeys(self.signals, samples)
        if set(chunks) != set(self.signals):
            raise UserError(
                f"This stream takes {' and '.join(self.signals)} with every push; give "
                f"{', '.join(f'{name}=SAMPLES' for name in self.signals)}."
            )
        touched = self.classifier.contact, self.classifier.changed_at
        taken = {name: self.signals[name].take(chunk) for name, chunk in chunks.items()}
        vote = self.classifier.push(taken)
        if touched != (self.classifier.contact, self.classifier.changed_at):
            for signal in self.signals.values():
                signal.forget()
        return self._describe(vote, begin)

    def finish(self) -> Prediction:
        """Compute what waits, so that the prediction is that of all samples; the stream ends."""
        begin = time.perf_counter()
        rests = {name: signal.rest() for name, signal in self.signals.items()}
        if self.classifier.contact is None:
            self.classifier.push({name: rest for name, rest in rests.items() if rest is not None})
        return self._describe(self.classifier.finish(), begin)

    def check(self) -> None:
        """Make sure that there was a vote, if anything was touched.

        Raises:
            UserError: Saying how much signal it takes.
        """
        self.classifier.check()

    def _describe(self, vote: Vote | None, begin: float) -> Prediction:
        synchronise(self.device)
        levels = self._levels()
        found = [signal.quality(levels.get(name)) for name, signal in self.signals.items()]
        quality = together([*found, *self.photo_quality])
        latency = time.perf_counter() - begin
        said = self.card.modalities if len(self.card.senses) > 1 else ()
        prediction = describe(vote, self.card, quality, self.top_k, latency, said)
        voter = self.classifier
        return replace(prediction, contact=voter.contact, changed_at=voter.changed_at)

    def _levels(self) -> dict[str, float]:
        """Of what votes, by modality, to be compared with the training's."""
        if isinstance(self.classifier, WindowVote):
            return self.classifier.levels
        every = self.signals.items()
        return {name: signal.monitor.level for name, signal in every if signal.monitor.count}


@torch.inference_mode()
def _senses(classifier: SurfaceClassifier, photos: Mapping[str, Tensor]) -> dict[str, Sensed]:
    """Compute the scores of the photos, once for all."""
    return {
        name: classifier.sense(name, photos[branch.modality])
        for name, branch in classifier.branches.items()
        if branch.modality in photos
    }
