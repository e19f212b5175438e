"""A live recording: samples in, predictions out.

Samples are resampled to the rate of the training. Every vote classifies anew: everything so far,
or the last seconds (``stream.window``). A fragment of HapticNet sees 2 s; a spectrogram of a window
that is shorter is repeated until it fills one: a texture goes on as it began.
"""

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SenseOutput, SurfaceClassifier
from tex_lightning.classifier.vote import Vote
from tex_lightning.config import StreamConfig
from tex_lightning.core.devices import synchronise
from tex_lightning.data.decode import Array, Resampler, as_trace
from tex_lightning.data.quality import Quality, Ranges, TraceMonitor, together
from tex_lightning.errors import UserError
from tex_lightning.inference.prediction import Prediction, describe
from tex_lightning.senses.signal import SignalSense

MIN_SECONDS = 0.3  # of a window that votes


class LiveSignal:
    """Check, measure and resample the incoming samples.

    Args:
        sense: Sense of the signal.
        rate: Rate of the samples in Hz; None is the checkpoint's.
        ranges: Ranges of the training recordings, with which warnings compare.
        window: Length in seconds of what is kept, the end of the signal; None keeps everything.

    Attributes:
        rate: Rate in Hz that samples must have.
        samples: How many came.
        raw: Kept samples (axes, samples) as they came.
        recording: The same in float32 at the checkpoint's rate.

    Raises:
        UserError: If there is no such rate, or it is too far from the checkpoint's.
    """

    def __init__(
        self, sense: SignalSense, rate: float | None, ranges: Ranges, window: float | None
    ) -> None:
        self.target = sense.decoder.sampling_rate
        self.modality, self.what, self.ranges = sense.modality, sense.what, ranges
        self.channels, self.window = sense.decoder.channels, window
        self.rate = self.target if rate is None else rate
        if not self.rate > 0:
            raise UserError(f"rate is {self.rate:g}; give the sampling rate in Hz.")
        self.resampler: Resampler | None = None
        self.measures: dict[str, float] = {}  # beside the level
        if self.rate != self.target:
            self.resampler = Resampler(self.rate, self.target, sense.modality)
            self.measures["rate"] = min(self.rate, self.target)
        self.axes: int | None = None  # not known yet
        self.samples = 0
        self.recording, self.raw = np.empty((0, 0), np.float32), np.empty((0, 0))

    def push(self, samples: Any) -> None:  # noqa: ANN401  (what NumPy can read)
        """Take more samples.

        Args:
            samples: (samples,) or (axes, samples), as many axes as before.

        Raises:
            UserError: If they are no such samples.
        """
        chunk = as_trace(samples, self.modality, self.channels, is_chunk=True)
        self.axes = self.axes or len(chunk)
        if len(chunk) != self.axes:
            raise UserError(
                f"A chunk has the shape {tuple(np.shape(samples))}; give (axes, samples) with as "
                f"many axes as before, {self.axes}."
            )
        self.samples += chunk.shape[1]
        self.raw = self._joined(self.raw, chunk, self.rate)
        self._keep(chunk if self.resampler is None else self.resampler.push(chunk))

    def finish(self) -> None:
        """Take the last samples, which the filter of the resampling holds back."""
        rest = None if self.resampler is None else self.resampler.finish()
        if rest is not None:
            self._keep(rest)

    def quality(self) -> Quality:
        """Return the faults of the kept samples."""
        if not self.raw.size:
            return Quality()
        monitor = TraceMonitor(self.what)
        monitor.update(self.raw)  # resampling would blur what is constant or clipped
        return monitor.quality(self.ranges, level=monitor.level, **self.measures)

    def _keep(self, resampled: Array) -> None:
        self.recording = self._joined(self.recording, resampled.astype(np.float32), self.target)

    def _joined(self, old: Array, new: Array, rate: float) -> Array:
        """Return samples (axes, samples) at ``rate`` in Hz, of a window only its last seconds."""
        joined = np.concatenate((old, new), axis=1) if old.size else new
        return joined if self.window is None else joined[:, -round(self.window * rate) :].copy()


class LiveStream:
    """Take samples as they come and predict from all of them so far, or from the last seconds.

    Args:
        classifier: The accelerated classifier of the given senses.
        rates: Sampling rate in Hz by modality of each signal; None is the checkpoint's.
        photos: Decoded, by modality, with what is wrong with them; they stay as they are.
        config: ``window``.
        top_k: How many classes a prediction lists.

    Attributes:
        signals: The signals by modality, with their ``rate``.

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
        self.card, self.classifier, self.top_k = classifier.card, classifier, top_k
        self.window, ranges = config.window, self.card.input_ranges
        senses = classifier.senses
        self.live = {name: each for name, each in senses.items() if isinstance(each, SignalSense)}
        self.signals = {
            modality: LiveSignal(sense, rates[modality], ranges.get(modality, {}), self.window)
            for modality, sense in ((each.modality, each) for each in self.live.values())
        }
        self.photo_quality = [quality for _, quality in photos.values()]
        with torch.inference_mode():
            self.fixed = {
                name: classifier.sense_output(name, photos[sense.modality][0])
                for name, sense in senses.items()
                if name not in self.live
            }
        # why there was no vote yet
        self.failure: UserError | None = UserError(
            "The stream ended too soon for a vote; send more signal."
        )

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
        for name, chunk in chunks.items():
            self.signals[name].push(chunk)
        return self._predict(begin)

    def finish(self) -> Prediction:
        """Compute what waits, so that the prediction is that of all samples; the stream ends."""
        begin = time.perf_counter()
        for signal in self.signals.values():
            signal.finish()
        return self._predict(begin)

    def check(self) -> None:
        """Make sure that there was a vote.

        Raises:
            UserError: Saying how much signal it takes.
        """
        if self.failure is not None:
            raise self.failure

    @torch.inference_mode()
    def _predict(self, begin: float) -> Prediction:
        outputs = self._outputs()
        vote: Vote | None = None
        if outputs is not None:  # random tuples have the same seed every time
            seed = self.card.decision["seed"]
            vote = self.classifier.vote({**self.fixed, **outputs}, seed)
        synchronise(self.classifier.device)
        latency = time.perf_counter() - begin
        used = self.card.modalities if len(self.card.sense_names) > 1 else ()
        signals = [signal.quality() for signal in self.signals.values()]
        quality = together([*signals, *self.photo_quality])
        return describe(vote, self.card, quality, self.top_k, latency, used)

    def _outputs(self) -> dict[str, SenseOutput] | None:
        """Return what the live senses give for their recordings; None if one is too short."""
        least = 0.0 if self.window is None else MIN_SECONDS
        if any(each.recording.shape[1] <= least * each.target for each in self.signals.values()):
            return None
        try:
            outputs = {name: self._output(name, sense) for name, sense in self.live.items()}
        except UserError as error:
            self.failure = self.failure and error
            return None
        self.failure = None
        return outputs

    def _output(self, name: str, sense: SignalSense) -> SenseOutput:
        """Return what a live sense gives; short inputs of a window are repeated to a fragment."""
        recording = torch.from_numpy(self.signals[sense.modality].recording)
        if self.window is None or sense.geometry is None:
            return self.classifier.sense_output(name, recording)
        x = sense.dense_input(recording)
        frames = max(x.shape[-1], sense.window_size[1])
        x = x[..., torch.arange(frames, device=x.device) % x.shape[-1]]
        grid = sense.dense_grid(x, self.classifier.embedding_layer(name))
        return self.classifier.output_of(name, grid.flatten(1))
