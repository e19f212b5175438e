"""A live recording: samples in, predictions out.

Samples are resampled to the rate of the training. A vote goes on from the one before
(:mod:`~tex_lightning.inference.continued`), where the classifier allows it. Else, and over the last
seconds (``stream.window``), every vote classifies anew. A fragment of HapticNet sees 2 s; a
spectrogram of a window that is shorter is repeated until it fills one: a texture goes on as it
began.
"""

import time
from collections.abc import Mapping
from typing import Any, cast

import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SenseOutput, SurfaceClassifier
from tex_lightning.classifier.vote import Vote
from tex_lightning.config import StreamConfig
from tex_lightning.core.devices import synchronise
from tex_lightning.errors import UserError
from tex_lightning.inference.continued import Continued, continued
from tex_lightning.inference.live_signal import FlowingSignal, LiveSignal
from tex_lightning.inference.prediction import Prediction, make_prediction
from tex_lightning.senses.signal import SignalSense
from tex_lightning_runtime.quality import Quality, together

MIN_SECONDS = 0.3  # of a window that votes


class LiveStream:
    """Take samples as they come and predict from all of them so far, or from the last seconds.

    Args:
        classifier: The accelerated classifier of the given senses.
        rates: Sampling rate in Hz by modality of each signal; None is the checkpoint's.
        photos: Decoded, by modality, with what is wrong with them; they stay as they are.
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
        self.continued = continued(classifier) if self.window is None else None
        self.signals: dict[str, LiveSignal] = {}
        for sense in self.live.values():
            name, rate = sense.modality, rates[sense.modality]
            ranges = self.card.input_ranges.get(name, {})
            flows = self.continued is not None
            self.signals[name] = (
                FlowingSignal(sense, rate, ranges)
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
        vote, quality = self._continue(chunks) if self.continued else self._anew(chunks)
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
    def _continue(self, chunks: Mapping[str, Any]) -> tuple[Vote | None, Quality]:
        """Vote with further samples of the only signal."""
        ((name, chunk),) = chunks.items()
        signal = cast(FlowingSignal, self.signals[name])
        new, ahead, quality = signal.take(chunk)
        try:
            vote: Vote | None = cast(Continued, self.continued).push(new, ahead)
            self.failure = None
        except UserError as error:
            vote, self.failure = None, self.failure and error
        return vote, quality

    @torch.inference_mode()
    def _anew(self, chunks: Mapping[str, Any]) -> tuple[Vote | None, Quality]:
        """Vote by everything that is kept."""
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
        """Return what the live senses give for their recordings; None if one is too short."""
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
        """Return what a live sense gives; short inputs of a window are repeated to a fragment."""
        if self.window is None or sense.geometry is None:
            return self.classifier.sense_output(name, recording)
        x = sense.dense_input(recording)
        frames = max(x.shape[-1], sense.window_size[1])
        x = x[..., torch.arange(frames, device=x.device) % x.shape[-1]]
        grid = sense.dense_grid(x, self.classifier.embedding_layer(name))
        return self.classifier.output_of(name, grid.flatten(1))
