"""A live recording: samples in, predictions out.

Samples are resampled to the rate of the training. Every vote classifies anew: everything so far, or
the last seconds (``stream.window``). A fragment of HapticNet sees 2 s; a spectrogram of a window
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
from tex_lightning.data.decode import Array
from tex_lightning.errors import UserError
from tex_lightning.inference.prediction import Prediction, make_prediction
from tex_lightning.senses.signal import SignalSense
from tex_lightning_runtime.quality import Quality, together
from tex_lightning_runtime.resampling import rate_ratio
from tex_lightning_runtime.samples import as_trace

MIN_SECONDS = 0.3  # of a window that votes


class LiveSignal:
    """Check and keep the incoming samples.

    Args:
        sense: Sense of the signal.
        rate: Rate of the samples in Hz; None is the checkpoint's.
        window: Length in seconds of what is kept, the end of the signal; None keeps everything.

    Attributes:
        rate: Rate in Hz that samples must have.
        samples: Number of samples so far.
        kept: Kept samples (axes, samples) as they came; None before the first.

    Raises:
        UserError: If there is no such rate, or it is too far from the checkpoint's.
    """

    def __init__(self, sense: SignalSense, rate: float | None, window: float | None) -> None:
        self.sense, target = sense, sense.decoder.sampling_rate
        self.rate = target if rate is None else rate
        rate_ratio(self.rate, target, sense.modality)
        self.limit = None if window is None else round(window * self.rate)
        self.samples = 0
        self.kept: Array | None = None

    def push(self, samples: Any) -> None:  # noqa: ANN401  (what NumPy can read)
        """Append samples.

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
        self.signals = {
            sense.modality: LiveSignal(sense, rates[sense.modality], self.window)
            for sense in self.live.values()
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
        for name, chunk in chunks.items():
            self.signals[name].push(chunk)
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
        inputs: dict[str, Tensor] = {}
        qualities = list(self.photo_quality)
        for modality, signal in self.signals.items():
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
        synchronise(self.classifier.device)
        latency = time.perf_counter() - begin
        used = self.card.modalities if len(self.card.sense_names) > 1 else ()
        return make_prediction(vote, self.card, together(qualities), self.top_k, latency, used)

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
