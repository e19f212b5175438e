"""A live recording: samples in, predictions out.

Samples are resampled to the rate of the training. The vote is over everything so far, no sample
computed twice, or over the last seconds (``stream.window``). A fragment of HapticNet sees 2 s, so
that its scores cannot follow within one; the samples of the window are therefore classified afresh
with every vote, and a spectrogram that is shorter than a fragment is repeated until it fills one: a
texture goes on as it began.
"""

import time
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SenseOutput, SurfaceClassifier
from tex_lightning.classifier.vote import Vote
from tex_lightning.config import StreamConfig
from tex_lightning.core.devices import synchronise
from tex_lightning.data.decode import Resampler, as_trace
from tex_lightning.data.quality import Quality, Ranges, TraceMonitor, level, together
from tex_lightning.errors import UserError
from tex_lightning.inference.prediction import Prediction, describe
from tex_lightning.inference.stream_classifier import StreamingClassifier
from tex_lightning.senses.features.spectrogram import SETTLING_SECONDS
from tex_lightning.senses.signal import SignalSense

STEP_SECONDS = 0.1  # in which a window moves on
LEAST = 3  # steps that vote
SILENT = 3  # steps below the least level that are a pause; a stroke turns round more quickly
SETTLING = round(SETTLING_SECONDS / STEP_SECONDS)  # steps to steady movement, after that of a touch


class LiveSignal:
    """Check, measure and resample the incoming samples.

    Args:
        sense: Sense of the signal.
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
        self.modality, self.what, self.ranges = sense.modality, sense.what, ranges
        self.rate = target if rate is None else rate
        if not self.rate > 0:
            raise UserError(f"rate is {self.rate:g}; give the sampling rate in Hz.")
        self.resampler: Resampler | None = None
        self.measures: dict[str, float] = {}  # beside the level
        if self.rate != target:
            self.resampler = Resampler(self.rate, target, sense.modality)
            self.measures["rate"] = min(self.rate, target)
        self.axes: int | None = None  # not known yet
        self.samples = 0
        self.forget()

    def forget(self) -> None:
        """Forget the quality of the samples so far."""
        self.monitor = TraceMonitor(self.what)

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
        found = chunk if self.resampler is None else self.resampler.push(chunk)
        return torch.from_numpy(found).float()

    def rest(self) -> Tensor | None:
        """The last samples, which the filter of the resampling holds back; None if there are none.

        They end the stream.
        """
        found = None if self.resampler is None else self.resampler.finish()
        return None if found is None else torch.from_numpy(found)

    def quality(self, *, compared: bool) -> Quality:
        """Faults of the signal; whether its level is compared with the training's."""
        if not self.monitor.count:
            return Quality()
        level = {"level": self.monitor.level} if compared else {}
        return self.monitor.quality(self.ranges, **level, **self.measures)


class Window:
    """The samples of the last seconds, taken in whole steps, since something is touched.

    Args:
        seconds: Length.
        rates: Sampling rate in Hz by modality.
        least: Level by modality that is no touch.
        settling: Steps that are left out after that of a touch.

    Attributes:
        contact: Whether something is touched.
        changed_at: Where in the signal, in seconds, the last touch after a pause was; None if
            there was none.
        samples: (axes, samples) that vote, by modality.
        count: Steps that they consist of.
    """

    def __init__(
        self, seconds: float, rates: Mapping[str, float], least: Mapping[str, float], settling: int
    ) -> None:
        self.rates, self.least, self.settling = rates, least, settling
        self.room = round(seconds / STEP_SECONDS)
        self.pending: dict[str, Tensor] = {}  # samples that are no whole step yet
        self.steps = self.silent = self.unsettled = self.count = 0
        self.samples: dict[str, Tensor] = {}
        self.contact = False
        self.changed_at: float | None = None

    def push(self, chunks: Mapping[str, Tensor]) -> None:
        """Take samples (axes, samples) by modality."""
        waiting = _joined(self.pending, chunks)
        while all(waiting[name].shape[1] >= self._length(name) for name in waiting):
            sizes = {name: self._length(name) for name in waiting}
            self._step({name: each[:, : sizes[name]] for name, each in waiting.items()})
            waiting = {name: each[:, sizes[name] :] for name, each in waiting.items()}
        self.pending = {name: each.clone() for name, each in waiting.items()}

    def _length(self, modality: str) -> int:
        """Samples of the next step."""
        size = STEP_SECONDS * self.rates[modality]
        return round((self.steps + 1) * size) - round(self.steps * size)

    def _step(self, samples: Mapping[str, Tensor]) -> None:
        """Look for contact: a pause is several steps, a touch is one."""
        self.steps += 1
        loud = all(
            level(each.numpy(force=True)) > self.least[name] for name, each in samples.items()
        )
        self.silent = 0 if loud else self.silent + 1
        if self.contact and self.silent >= SILENT:
            self.contact, self.samples, self.count = False, {}, 0
        elif not self.contact and loud:
            self.contact = True
            if self.steps > 1:  # else it moved already
                self.changed_at = round((self.steps - 1) * STEP_SECONDS, 6)
                self.unsettled = self.settling + 1 if self.settling else 0
        if not self.contact or self.silent:
            return
        if self.unsettled:
            self.unsettled -= 1
            return
        self.count = min(self.count + 1, self.room)
        self.samples = {
            name: each[:, -round(self.room * STEP_SECONDS * self.rates[name]) :].clone()
            for name, each in _joined(self.samples, samples).items()
        }


class LiveStream:
    """Take samples as they come and predict from all of them so far, or from the last seconds.

    Args:
        classifier: The accelerated classifier of the given senses.
        rates: Sampling rate in Hz by modality of each signal; None is the checkpoint's.
        photos: Decoded, by modality, with what is wrong with them; they stay as they are.
        config: ``window`` and ``contact``.
        top_k: How many classes a prediction lists.

    Attributes:
        signals: The signals by modality, with their ``rate``.
        window: What votes of the last seconds; None votes over everything.
        streams: Otherwise by sense what computes its scores.

    Raises:
        UserError: If the classifier cannot be streamed.
    """

    def __init__(
        self,
        classifier: SurfaceClassifier,
        rates: Mapping[str, float | None],
        photos: Mapping[str, tuple[Tensor, Quality]],
        config: StreamConfig,
        top_k: int,
    ) -> None:
        self.card, self.device, self.top_k = classifier.card, classifier.device, top_k
        self.classifier = classifier if config.window is None else deepcopy(classifier)
        senses, ranges = self.classifier.senses, self.card.input_ranges
        self.live = {name: each for name, each in senses.items() if isinstance(each, SignalSense)}
        self.signals = {
            each.modality: LiveSignal(each, rates[each.modality], ranges.get(each.modality, {}))
            for each in self.live.values()
        }
        self.photo_quality = [quality for _, quality in photos.values()]
        with torch.inference_mode():
            self.fixed = {
                name: classifier.sense_output(name, photos[sense.modality][0])
                for name, sense in senses.items()
                if name not in self.live
            }
        # scores of fragments are kept where they are joined or averaged, else votes alone
        self.counted = len(senses) == 1 and self.card.rule != "score"
        self.streams: dict[str, StreamingClassifier] = {}
        self.window: Window | None = None
        if config.window is None:
            for name in self.live:
                part = classifier.with_senses([name])
                self.streams[name] = StreamingClassifier(part, keep_scores=not self.counted)
        else:
            self.window = self._make_window(config.window, config.contact)
        self.voted = False
        self.failure: UserError | None = None  # why there was no vote of a window yet

    def _make_window(self, seconds: float, contact: float) -> Window:
        """A window whose touches leave out what the features skipped before."""
        features: list[Any] = [sense.features for sense in self.live.values()]
        skipping = [each for each in features if getattr(each, "skip_impact", False)]
        for each in skipping:
            each.skip_impact = False
        rates = {each.modality: each.decoder.sampling_rate for each in self.live.values()}
        ranges = self.card.input_ranges
        least = {name: contact * ranges.get(name, {}).get("level", [0.0])[0] for name in rates}
        return Window(seconds, rates, least, SETTLING if skipping else 0)

    @property
    def rate(self) -> float:
        """Sampling rate in Hz that samples must have; with several signals, of the first."""
        return next(iter(self.signals.values())).rate

    @property
    def waiting(self) -> bool:
        """Whether a filter holds samples back, which :meth:`finish` computes."""
        return any(signal.resampler is not None for signal in self.signals.values())

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
        taken = {name: self.signals[name].take(chunk) for name, chunk in chunks.items()}
        return self._predict(taken, begin)

    def finish(self) -> Prediction:
        """Compute what waits, so that the prediction is that of all samples; the stream ends."""
        begin = time.perf_counter()
        rests = {name: signal.rest() for name, signal in self.signals.items()}
        return self._predict(
            {name: rest for name, rest in rests.items() if rest is not None}, begin
        )

    def check(self) -> None:
        """Make sure that there was a vote, if anything was touched.

        Raises:
            UserError: Saying how much signal it takes.
        """
        for stream in self.streams.values():
            stream.sense.check_input(1, stream.frames)
        if self.window is None or self.voted:
            return
        if self.failure is not None:
            raise self.failure
        if self.window.steps < LEAST:
            raise UserError(
                f"The stream ended within {LEAST * STEP_SECONDS:g} s, too soon for a vote; send "
                "more signal."
            )

    def _predict(self, taken: Mapping[str, Tensor], begin: float) -> Prediction:
        vote = self._vote_so_far(taken) if self.window is None else self._vote_window(taken)
        synchronise(self.device)
        contact = None if self.window is None else self.window.contact
        signals = self.signals.values()
        found = [signal.quality(compared=contact is not False) for signal in signals]
        quality = together([*found, *self.photo_quality])
        latency = time.perf_counter() - begin
        said = self.card.modalities if len(self.card.sense_names) > 1 else ()
        prediction = describe(vote, self.card, quality, self.top_k, latency, said)
        changed_at = None if self.window is None else self.window.changed_at
        return replace(prediction, contact=contact, changed_at=changed_at)

    @torch.inference_mode()
    def _vote_so_far(self, taken: Mapping[str, Tensor]) -> Vote | None:
        """Vote over everything; of several senses over random tuples of the same seed every time.

        What a sense that is fused on FC2 says alone is its partial logits.
        """
        for stream in self.streams.values():
            if stream.sense.modality in taken:
                stream.push(taken[stream.sense.modality])
        if any(stream.vote is None for stream in self.streams.values()):
            return None
        if self.counted:
            (stream,) = self.streams.values()
            novelty = None if stream.novelty is None else float(stream.novelty)
            return stream.vote and replace(stream.vote, novelty=novelty)
        whole, live = self.classifier, {}
        for name, stream in self.streams.items():
            own = whole.level(name) == "fc2"
            scores = stream.scores if own else whole.project(name, stream.scores)
            live[name] = SenseOutput(scores, stream.novelty)
        return whole.vote({**self.fixed, **live}, self.card.decision["seed"])

    @torch.inference_mode()
    def _vote_window(self, taken: Mapping[str, Tensor]) -> Vote | None:
        """Vote over the last seconds; None if they are too little for these features."""
        window = self.window
        assert window is not None
        before = window.contact, window.changed_at
        if taken:
            window.push(taken)
        if before != (window.contact, window.changed_at):
            for signal in self.signals.values():
                signal.forget()
        if window.count < LEAST:
            return None
        try:
            live = {
                name: self._output(name, sense, window.samples[sense.modality])
                for name, sense in self.live.items()
            }
        except UserError as error:
            self.failure = error
            return None
        self.voted = True
        return self.classifier.vote({**self.fixed, **live}, self.card.decision["seed"])

    def _output(self, name: str, sense: SignalSense, recording: Tensor) -> SenseOutput:
        """What a live sense says of an input that is repeated to the size of a fragment."""
        if sense.geometry is None:
            return self.classifier.sense_output(name, recording)
        x, level = sense.dense_input(recording), self.classifier.embedding_layer(name)
        frames = max(x.shape[-1], sense.window_size[1])
        x = x[..., torch.arange(frames, device=x.device) % x.shape[-1]]
        return self.classifier.output_of(name, sense.dense(x, level))


def _joined(old: Mapping[str, Tensor], new: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name: torch.cat((old[name], new[name]), dim=1) if old else new[name] for name in new}
