"""A live recording: samples in, predictions out.

Samples are resampled to the rate of the training. The vote is over everything so far
(:class:`WholeVote`), or over the last seconds (:class:`.stream_window.WindowVote`).
"""

import logging
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SenseOutput, SurfaceClassifier
from tex_lightning.classifier.vote import Vote
from tex_lightning.config import StreamConfig
from tex_lightning.core.devices import synchronise
from tex_lightning.data.arrays import as_trace
from tex_lightning.data.decode import Resampler
from tex_lightning.data.quality import Quality, Ranges, TraceMonitor, together
from tex_lightning.errors import UserError
from tex_lightning.inference.prediction import Prediction, describe
from tex_lightning.inference.stream_classifier import StreamingClassifier
from tex_lightning.inference.stream_window import WindowVote
from tex_lightning.senses.signal import SignalSense

log = logging.getLogger(__name__)


class WholeVote:
    """Vote over the whole recording so far, no sample computed twice.

    Args:
        classifier: Accelerated; a :class:`StreamingClassifier` takes each of its live senses.
        fixed: By sense what is said of a photo, which stays as it is.
        wait: See :class:`StreamingClassifier`.

    Attributes:
        contact: Whether something is touched; None: it is not looked at.
        changed_at: When the vote began anew, in seconds; None: it never does.

    Raises:
        UserError: If a sense cannot be streamed, or samples of several were to wait.
    """

    contact: bool | None = None
    changed_at: float | None = None

    def __init__(
        self, classifier: SurfaceClassifier, fixed: Mapping[str, SenseOutput], wait: float
    ) -> None:
        self.classifier, self.fixed = classifier, fixed
        # scores of fragments are kept where they are joined or averaged, else votes alone
        self.counted = len(classifier.card.sense_names) == 1 and classifier.card.rule != "score"
        if wait > 0 and not self.counted:
            raise UserError(
                "stream.wait is for a single sense that decides by decision.rule=vote or mean, and "
                "this is none: set stream.wait=0."
            )
        self.streams = {
            name: StreamingClassifier(
                classifier.with_senses([name]), wait=wait, keep_scores=not self.counted
            )
            for name in classifier.card.sense_names
            if name not in fixed
        }

    @property
    def waiting(self) -> bool:
        """Whether samples were left uncomputed, which :meth:`finish` computes."""
        return any(stream.waiting is not None for stream in self.streams.values())

    def push(self, chunks: Mapping[str, Tensor]) -> Vote | None:
        """Take samples (axes, samples) by modality and vote over all so far."""
        for stream in self.streams.values():
            if stream.sense.modality in chunks:
                stream.push(chunks[stream.sense.modality])
        return self._vote()

    def finish(self) -> Vote | None:
        """Compute what waits."""
        for stream in self.streams.values():
            stream.finish()
        return self._vote()

    def check(self) -> None:
        """Make sure that every sense had a fragment.

        Raises:
            UserError: Saying how much signal it takes.
        """
        for stream in self.streams.values():
            stream.sense.check_frames(stream.frames)

    @torch.inference_mode()
    def _vote(self) -> Vote | None:
        """Of several senses over random tuples of their fragments, of the same seed every time."""
        if any(stream.vote is None for stream in self.streams.values()):
            return None
        if self.counted:
            return self._counted()
        whole = self.classifier
        streams = self.streams.items()
        live = {
            name: SenseOutput(self._partial_logits(name), each.novelty) for name, each in streams
        }
        return whole.vote({**self.fixed, **live}, whole.card.decision["seed"])

    def _counted(self) -> Vote | None:
        (stream,) = self.streams.values()
        if stream.vote is None or stream.novelty is None:
            return stream.vote
        return replace(stream.vote, novelty=float(stream.novelty))

    def _partial_logits(self, name: str) -> Tensor:
        """What a live sense adds: a part that is fused on FC2 has its partial logits as scores."""
        scores = self.streams[name].scores
        own = self.classifier.level(name) == "fc2"
        return scores if own else self.classifier.project(name, scores)


class LiveSignal:
    """Check, measure and resample the incoming samples.

    Args:
        branch: Sense of the sense.
        rate: Rate of the samples in Hz; None is the checkpoint's.
        ranges: Ranges of the training recordings, with which warnings compare.

    Attributes:
        rate: Rate in Hz that samples must have.
        samples: How many came.

    Raises:
        UserError: If there is no such rate, or it is too far from the checkpoint's.
    """

    def __init__(self, sense: SignalSense, rate: float | None, ranges: Ranges) -> None:
        target = sense.decoder.sampling_rate
        self.modality, self.ranges = sense.modality, ranges
        self.rate = target if rate is None else rate
        if not self.rate > 0:
            raise UserError(f"rate is {self.rate:g}; give the sampling rate in Hz.")
        self.resampler: Resampler | None = None
        self.measures: dict[str, float] = {}  # beside the level
        if self.rate != target:
            self.resampler = Resampler(self.rate, target, sense.modality)
            self.measures["rate"] = min(self.rate, target)
        self.monitor = TraceMonitor(sense.what)
        self.axes: int | None = None  # not known yet
        self.samples = 0

    def take(self, samples: Any) -> Tensor:  # noqa: ANN401  (what NumPy can read)
        """Samples (axes, samples) float32 at the checkpoint's rate.

        Args:
            samples: (samples,) or (axes, samples), as many axes as before.

        Raises:
            UserError: If they are no such samples.
        """
        chunk = as_trace(samples, self.modality)
        axes, shape = self.axes or len(chunk), tuple(np.shape(samples))
        if shape != (axes, chunk.size // axes) and not (axes == len(shape) == 1):
            raise UserError(
                f"A chunk has the shape {shape}; give (axes, samples) with as many axes as before, "
                f"{axes}."
            )
        self.axes = axes
        self.samples += chunk.shape[1]
        self.monitor.update(chunk)  # resampling would blur what is constant or clipped
        found: npt.NDArray[Any] = chunk if self.resampler is None else self.resampler.push(chunk)
        return torch.from_numpy(found).float()

    def rest(self) -> Tensor | None:
        """The last samples, which the filter of the resampling holds back; None if there are none.

        They end the stream.
        """
        found = None if self.resampler is None else self.resampler.finish()
        return None if found is None else torch.from_numpy(found)

    def forget(self) -> None:
        """Forget the quality of the samples so far."""
        self.monitor = TraceMonitor(self.monitor.what)

    def quality(self, level: float | None) -> Quality:
        """Faults of the signal.

        Args:
            level: Level that is compared with the training; None compares none.
        """
        if not self.monitor.count:
            return Quality()
        measures = self.measures if level is None else {"level": level, **self.measures}
        return self.monitor.quality(self.ranges, **measures)


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
        senses: dict[str, Any] = {each.modality: each for each in classifier.senses.values()}
        self.signals = {
            name: LiveSignal(senses[name], rate, self.card.input_ranges.get(name, {}))
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
        said = self.card.modalities if len(self.card.sense_names) > 1 else ()
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
def _senses(classifier: SurfaceClassifier, photos: Mapping[str, Tensor]) -> dict[str, SenseOutput]:
    """Compute the scores of the photos, once for all."""
    return {
        name: classifier.sense_output(name, photos[sense.modality])
        for name, sense in classifier.senses.items()
        if sense.modality in photos
    }
