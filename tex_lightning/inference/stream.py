"""Classify a live recording: samples in, predictions out.

Samples are resampled to the rate of the training. Where the classifier allows it, new samples
update the vote so far (:mod:`~tex_lightning.inference.running_vote`). Other classifiers, and all
with ``stream.window``, classify the kept samples again with every push. A window may be shorter
than a fragment, of 2 s for HapticNet: its spectrogram is then repeated up to that length.
"""

import time
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SenseOutput, SurfaceClassifier
from tex_lightning.classifier.vote import Vote
from tex_lightning.config import StreamConfig
from tex_lightning.core.devices import synchronise
from tex_lightning.data.decode import Array
from tex_lightning.errors import UserError
from tex_lightning.inference.early_stopping import is_local
from tex_lightning.inference.prediction import Prediction, make_prediction
from tex_lightning.inference.running_proportions import RunningProportionsVote
from tex_lightning.inference.running_spectrogram import RunningSpectrogramVote
from tex_lightning.inference.running_vote import RunningVote
from tex_lightning.networks.linear import LinearNet
from tex_lightning.senses.features.proportions import BandProportions
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures
from tex_lightning.senses.signal import SignalSense
from tex_lightning_runtime.quality import Level, Quality, Ranges, Survey, limits, together
from tex_lightning_runtime.resampling import (
    AROUND,
    REACH,
    RECENT_SECONDS,
    find_spikes,
    rate_ratio,
    resampled,
    without_spikes,
)  # fmt: skip
from tex_lightning_runtime.samples import as_trace

MIN_SECONDS = 0.3  # of a window that votes


class LiveSignal:
    """Check incoming samples and keep them, or the last seconds of them.

    Args:
        sense: Sense of the signal.
        rate: Rate of the samples in Hz; None is the checkpoint's.
        window: Seconds that are kept of the end of the signal; None keeps everything.

    Attributes:
        rate: Rate in Hz that samples must have.
        samples: Number of samples so far.
        kept: Kept samples (axes, samples) as they came; None before the first.

    Raises:
        UserError: If there is no such rate, or it is too far from the checkpoint's.
    """

    def __init__(self, sense: SignalSense, rate: float | None, window: float | None = None) -> None:
        self.sense, target = sense, sense.decoder.sampling_rate
        self.rate = target if rate is None else rate
        self.ratio = rate_ratio(self.rate, target, sense.modality)
        self.limit = None if window is None else round(window * self.rate)
        self.samples = 0
        self.kept: Array | None = None

    def push(self, samples: Any) -> Array:  # noqa: ANN401  (what NumPy can read)
        """Append samples and return them as (axes, samples).

        Args:
            samples: (samples,) or (axes, samples), as many axes as before.

        Raises:
            UserError: If they are no such samples.
        """
        decoder, name = self.sense.decoder, self.sense.modality
        chunk = as_trace(samples, name, decoder.channels, is_chunk=True)
        kept = chunk[:, :0] if self.kept is None else self.kept
        if len(chunk) != len(kept):
            raise UserError(
                f"A chunk has the shape {tuple(np.shape(samples))}; give (axes, samples) with as "
                f"many axes as before, {len(kept)}."
            )
        self.samples += chunk.shape[1]
        self.kept = np.concatenate((kept, chunk), axis=1)
        if self.limit is not None:
            self.kept = self.kept[:, -self.limit :].copy()
        return chunk


class ResampledSignal(LiveSignal):
    """Resample incoming samples, and keep only those that resampling the next ones needs.

    Args:
        sense: Sense of the signal.
        rate: Rate of the samples in Hz; None is the checkpoint's.
        ranges: Ranges of the measures of the training recordings.
    """

    def __init__(self, sense: SignalSense, rate: float | None, ranges: Ranges) -> None:
        super().__init__(sense, rate)
        self.usual, self.survey, self.level = limits(ranges), Survey(), Level()
        self.dropped = self.given = 0  # samples, before and after resampling
        self.spikes: Array = np.zeros((0, 2), np.int64)  # axis and place of the last dropped ones

    def take(self, samples: Any) -> tuple[Tensor, Tensor, Quality]:  # noqa: ANN401
        """Append samples; return what is new at the checkpoint's rate, and the quality so far.

        The end of a resampled signal depends on samples that are still to come. It is computed as
        if the signal ended here, and returned again, changed, by the next call.

        Returns:
            New samples (axes, samples) that are final; the preliminary ones after them; the quality
            of all samples so far.

        Raises:
            UserError: If they are no such samples.
        """
        self.survey.add(self.push(samples))
        new, ahead = self._resampled()
        self.level = self.level.plus(new)
        target = self.sense.decoder.sampling_rate
        measures = {"level": self.level.plus(ahead).value, "rate": min(self.rate, target)}
        quality = self.survey.quality(self.usual, self.sense.noun, measures)
        return torch.from_numpy(new), torch.from_numpy(ahead), quality

    def _resampled(self) -> tuple[Array, Array]:
        kept, (up, down) = self.kept, self.ratio.as_integer_ratio()
        assert kept is not None
        half = AROUND * up + (REACH * max(up, down) if self.ratio != 1 else 0)  # in 1 / up samples
        final = max(self.given, (self.samples * up - half - 1) // down + 1)
        spikes = np.concatenate((np.subtract(self.spikes, (0, self.dropped)), find_spikes(kept)))
        every = resampled(without_spikes(kept, self.rate, spikes), self.ratio)
        every = every[:, self.given - self.dropped * up // down :]
        new, ahead = every[:, : final - self.given].copy(), every[:, final - self.given :].copy()
        self.given = final
        needed = max(0, (final * down - half) // up // down * down)
        ago = needed + AROUND - self.dropped - spikes[:, 1]  # 0 and below are found again
        recent = spikes[(ago > 0) & (ago <= AROUND + RECENT_SECONDS * self.rate)]
        self.spikes = np.add(recent, (0, self.dropped))
        self.kept, self.dropped = kept[:, needed - self.dropped :].copy(), needed
        return new, ahead


class LiveStream:
    """Predict from all samples that were pushed so far, or from the last seconds of them.

    Args:
        classifier: The accelerated classifier of the given senses.
        rates: Sampling rate in Hz by modality of each signal; None is the checkpoint's.
        photos: Decoded photos by modality with their quality, the same for the whole stream.
        config: ``window``.
        top_k: Number of classes that a prediction lists.

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
        self.window, senses = config.window, classifier.senses
        self.live = {name: x for name, x in senses.items() if isinstance(x, SignalSense)}
        self.running_vote = running_vote(classifier) if self.window is None else None
        self.signals: dict[str, LiveSignal] = {}
        for sense in self.live.values():
            name, rate = sense.modality, rates[sense.modality]
            ranges = self.card.input_ranges.get(name, {})
            flows = self.running_vote is not None
            self.signals[name] = (
                ResampledSignal(sense, rate, ranges)
                if flows
                else LiveSignal(sense, rate, self.window)
            )
        self.photo_quality = [quality for _, quality in photos.values()]
        with torch.inference_mode():
            self.fixed = {
                name: classifier.sense_output(name, photos[sense.modality][0])
                for name, sense in senses.items()
                if name not in self.live
            }
        # why there was no vote yet
        self.failure: UserError | None = UserError(
            "The stream ended before the first fragment; send more signal."
        )

    @property
    def rate(self) -> float:
        """Sampling rate in Hz that samples must have; with several signals, of the first."""
        return next(iter(self.signals.values())).rate

    def push(self, samples: Any = None, /, **chunks: Any) -> Prediction:  # noqa: ANN401  (what NumPy can read)
        """Append samples and predict.

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
        vote, quality = self._extended(chunks) if self.running_vote else self._anew(chunks)
        synchronise(self.classifier.device)
        latency = time.perf_counter() - begin
        used = self.card.modalities if len(self.card.sense_names) > 1 else ()
        return make_prediction(vote, self.card, quality, self.top_k, latency, used)

    def check(self) -> None:
        """Make sure that there was a vote.

        Raises:
            UserError: Saying how much signal it takes.
        """
        if self.failure is not None:
            raise self.failure

    @torch.inference_mode()
    def _extended(self, chunks: Mapping[str, Any]) -> tuple[Vote | None, Quality]:
        """Update the running vote with samples of the only signal."""
        ((name, chunk),) = chunks.items()
        signal = cast(ResampledSignal, self.signals[name])
        new, ahead, quality = signal.take(chunk)
        try:
            vote: Vote | None = cast(RunningVote, self.running_vote).push(new, ahead)
            self.failure = None
        except UserError as error:
            vote, self.failure = None, self.failure and error
        return vote, quality

    @torch.inference_mode()
    def _anew(self, chunks: Mapping[str, Any]) -> tuple[Vote | None, Quality]:
        """Classify all samples that are kept, again."""
        inputs: dict[str, Tensor] = {}
        qualities = list(self.photo_quality)
        for modality, signal in self.signals.items():
            signal.push(chunks[modality])
            if signal.kept is not None:
                ranges = self.card.input_ranges.get(modality, {})
                whole = signal.kept, signal.rate, ranges, modality
                inputs[modality], quality = signal.sense.resample(*whole)
                qualities.append(quality)
        outputs = self._outputs(inputs)
        vote: Vote | None = None
        if outputs is not None:  # random tuples have the same seed every time
            seed = self.card.decision["seed"]
            vote = self.classifier.vote({**self.fixed, **outputs}, seed)
        return vote, together(qualities)

    def _outputs(self, recordings: Mapping[str, Tensor]) -> dict[str, SenseOutput] | None:
        """Return the outputs of the live senses; None if a recording is too short."""
        for sense in self.live.values() if self.window is not None else ():
            if recordings[sense.modality].shape[1] <= MIN_SECONDS * sense.decoder.sampling_rate:
                return None
        try:
            outputs = {
                name: self._output(name, sense, recordings[sense.modality])
                for name, sense in self.live.items()
            }
        except UserError as error:
            self.failure = self.failure and error
            return None
        self.failure = None
        return outputs

    def _output(self, name: str, sense: SignalSense, recording: Tensor) -> SenseOutput:
        """Return the output of a live sense; a window shorter than a fragment is repeated."""
        if self.window is None or sense.geometry is None:
            return self.classifier.sense_output(name, recording)
        x = sense.dense_input(recording)
        frames = max(x.shape[-1], sense.window_size[1])
        x = x[..., torch.arange(frames, device=x.device) % x.shape[-1]]
        return self.classifier.output_of(name, self.classifier.embedding_of_input(name, x))


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
    if type(features) is SpectrogramFeatures and is_local(sense):
        return RunningSpectrogramVote(classifier)
    return None
