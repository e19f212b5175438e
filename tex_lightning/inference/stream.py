"""A live recording: samples in, predictions out.

Samples are resampled to the rate of the training. Every vote classifies anew: everything so far,
or the last seconds (``stream.window``). A fragment of HapticNet sees 2 s; a spectrogram of a window
that is shorter is repeated until it fills one: a texture goes on as it began.
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
from tex_lightning.senses.features.spectrogram import SETTLING_SECONDS
from tex_lightning.senses.signal import SignalSense

STEP_SECONDS = 0.1  # in which a window moves on
MIN_STEPS = 3  # that vote
MAX_SILENT = 3  # steps below the least level are a pause; a stroke turns round more quickly
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
        monitor: Measures faults of the samples; a new one forgets them.

    Raises:
        UserError: If there is no such rate, or it is too far from the checkpoint's.
    """

    def __init__(self, sense: SignalSense, rate: float | None, ranges: Ranges) -> None:
        target = sense.decoder.sampling_rate
        self.modality, self.what, self.ranges = sense.modality, sense.what, ranges
        self.channels = sense.decoder.channels
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
        self.monitor = TraceMonitor(self.what)

    def push(self, samples: Any) -> Tensor:  # noqa: ANN401  (what NumPy can read)
        """Return samples (axes, samples) float32 at the checkpoint's rate.

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
        self.monitor.update(chunk)  # resampling would blur what is constant or clipped
        resampled = chunk if self.resampler is None else self.resampler.push(chunk)
        return torch.from_numpy(resampled).float()

    def rest(self) -> dict[str, Tensor]:
        """Return by modality the last samples, which the filter of the resampling holds back."""
        samples = None if self.resampler is None else self.resampler.finish()
        return {} if samples is None else {self.modality: torch.from_numpy(samples)}

    def quality(self, *, compared: bool) -> Quality:
        """Return faults of the signal; ``compared`` checks its level against the training's."""
        if not self.monitor.count:
            return Quality()
        level = {"level": self.monitor.level} if compared else {}
        return self.monitor.quality(self.ranges, **level, **self.measures)


class Window:
    """The samples of the last seconds, in whole steps, since a surface is touched.

    Args:
        seconds: Length.
        rates: Sampling rate in Hz by modality.
        min_levels: Level by modality that is no touch.
        settling: Steps that are left out after that of a touch.

    Attributes:
        contact: Whether a surface is touched.
        samples: (axes, samples) that vote, by modality.
        steps: Steps so far.
        count: Steps of the samples that vote.
    """

    def __init__(
        self,
        seconds: float,
        rates: Mapping[str, float],
        min_levels: Mapping[str, float],
        settling: int,
    ) -> None:
        self.rates, self.min_levels, self.settling = rates, min_levels, settling
        self.max_steps = round(seconds / STEP_SECONDS)
        self.pending: dict[str, Tensor] = {}  # samples that are no whole step yet
        self.steps = self.silent = self.unsettled = self.count = 0
        self.samples: dict[str, Tensor] = {}
        self.contact = False

    def push(self, chunks: Mapping[str, Tensor]) -> None:
        """Take samples (axes, samples) by modality."""
        pending = {**self.pending, **_joined(self.pending, chunks)}
        while True:
            sizes = {name: self._step_length(rate) for name, rate in self.rates.items()}
            if any(pending[name].shape[1] < size for name, size in sizes.items()):
                break
            self._step({name: pending[name][:, :size] for name, size in sizes.items()})
            pending = {name: pending[name][:, size:] for name, size in sizes.items()}
        self.pending = {name: samples.clone() for name, samples in pending.items()}

    def _step_length(self, rate: float) -> int:
        """Return the samples of the next step."""
        size = STEP_SECONDS * rate
        return round((self.steps + 1) * size) - round(self.steps * size)

    def _step(self, samples: Mapping[str, Tensor]) -> None:
        """Detect contact, and keep samples of movement; a pause is several steps, a touch is one.

        A recording whose first step is loud began during the movement.
        """
        self.steps += 1
        levels = {name: level(chunk.numpy(force=True)) for name, chunk in samples.items()}
        loud = all(levels[name] > self.min_levels[name] for name in levels)
        self.silent = 0 if loud else self.silent + 1
        if self.contact and self.silent >= MAX_SILENT:
            self.contact, self.samples, self.count = False, {}, 0
        elif loud and not self.contact:
            self.contact = True
            self.unsettled = self.settling + 1 if self.settling and self.steps > 1 else 0
        if self.contact and loud:
            self._keep(samples)

    def _keep(self, samples: Mapping[str, Tensor]) -> None:
        if self.unsettled:
            self.unsettled -= 1
            return
        self.count = min(self.count + 1, self.max_steps)
        self.samples = {
            name: whole[:, -round(self.max_steps * STEP_SECONDS * self.rates[name]) :].clone()
            for name, whole in _joined(self.samples, samples).items()
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
        window: The last seconds, which vote; None votes over everything.
        samples: Otherwise all samples (axes, samples) by modality.

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
        self.samples: dict[str, Tensor] = {}
        self.window: Window | None = None
        if config.window is not None:
            self.window = self._make_window(config.window, config.contact)
        self.voted = False
        self.failure: UserError | None = None  # why there was no vote yet

    def _make_window(self, seconds: float, contact: float) -> Window:
        """Make a window whose touches leave out what the features skipped before."""
        features: list[Any] = [sense.features for sense in self.live.values()]
        skipping = [each for each in features if getattr(each, "skip_impact", False)]
        for each in skipping:
            each.skip_impact = False
        rates = {each.modality: each.decoder.sampling_rate for each in self.live.values()}
        ranges = self.card.input_ranges
        levels = {name: contact * ranges.get(name, {}).get("level", [0.0])[0] for name in rates}
        return Window(seconds, rates, levels, SETTLING if skipping else 0)

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
        resampled = {name: self.signals[name].push(chunk) for name, chunk in chunks.items()}
        return self._predict(resampled, begin)

    def finish(self) -> Prediction:
        """Compute what waits, so that the prediction is that of all samples; the stream ends."""
        begin = time.perf_counter()
        rests = [signal.rest() for signal in self.signals.values()]
        return self._predict({name: rest for each in rests for name, rest in each.items()}, begin)

    def check(self) -> None:
        """Make sure that there was a vote, if anything was touched.

        Raises:
            UserError: Saying how much signal it takes.
        """
        if self.voted:
            return
        if self.failure is not None:
            raise self.failure
        if self.window is None or self.window.steps < MIN_STEPS:
            raise UserError("The stream ended too soon for a vote; send more signal.")

    @torch.inference_mode()
    def _predict(self, chunks: Mapping[str, Tensor], begin: float) -> Prediction:
        recordings = self._recordings(chunks)
        outputs = None if recordings is None else self._outputs(recordings)
        vote: Vote | None = None
        if outputs is not None:  # random tuples have the same seed every time
            seed = self.card.decision["seed"]
            vote = self.classifier.vote({**self.fixed, **outputs}, seed)
        synchronise(self.device)
        contact = None if self.window is None else self.window.contact
        signals = self.signals.values()
        quality = [signal.quality(compared=contact is not False) for signal in signals]
        latency = time.perf_counter() - begin
        used = self.card.modalities if len(self.card.sense_names) > 1 else ()
        quality_of_all = together([*quality, *self.photo_quality])
        prediction = describe(vote, self.card, quality_of_all, self.top_k, latency, used)
        return replace(prediction, contact=contact)

    def _recordings(self, chunks: Mapping[str, Tensor]) -> Mapping[str, Tensor] | None:
        """Take samples (axes, samples) by modality; return those that vote, None if too few."""
        window = self.window
        if window is None:
            self.samples |= _joined(self.samples, chunks)
            return self.samples or None
        before = window.contact
        if chunks:
            window.push(chunks)
        if before != window.contact:  # faults of the pause are none of the movement
            for signal in self.signals.values():
                signal.monitor = TraceMonitor(signal.what)
        return None if window.count < MIN_STEPS else window.samples

    def _outputs(self, recordings: Mapping[str, Tensor]) -> dict[str, SenseOutput] | None:
        """Return what the live senses give for their recordings; None if one is too short."""
        try:
            outputs = {
                name: self._output(name, sense, recordings[sense.modality])
                for name, sense in self.live.items()
            }
        except UserError as error:
            self.failure = error
            return None
        self.voted = True
        return outputs

    def _output(self, name: str, sense: SignalSense, recording: Tensor) -> SenseOutput:
        """Return what a live sense gives; short inputs of a window are repeated to a fragment."""
        if self.window is None or sense.geometry is None:
            return self.classifier.sense_output(name, recording)
        x = sense.dense_input(recording)
        frames = max(x.shape[-1], sense.window_size[1])
        x = x[..., torch.arange(frames, device=x.device) % x.shape[-1]]
        grid = sense.dense_grid(x, self.classifier.embedding_layer(name))
        return self.classifier.output_of(name, grid.flatten(1))


def _joined(old: Mapping[str, Tensor], new: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name: torch.cat((old[name], new[name]), dim=1) if old else new[name] for name in new}
