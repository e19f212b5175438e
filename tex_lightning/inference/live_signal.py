"""Samples of a live signal as they come: checked, kept or resampled at once, judged."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from tex_lightning.data.decode import Array
from tex_lightning.errors import UserError
from tex_lightning.senses.signal import SignalSense
from tex_lightning_runtime.quality import Level, Quality, Ranges, Survey, limits
from tex_lightning_runtime.resampling import REACH, rate_ratio, to_rate
from tex_lightning_runtime.samples import as_trace


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


class FlowingSignal(LiveSignal):
    """Keep no more of the incoming samples than resampling the next ones takes.

    Args:
        sense: Sense of the signal.
        rate: Rate of the samples in Hz; None is the checkpoint's.
        ranges: Ranges of the measures of the training recordings.
    """

    def __init__(self, sense: SignalSense, rate: float | None, ranges: Ranges) -> None:
        super().__init__(sense, rate)
        self.usual, self.survey, self.level = limits(ranges), Survey(), Level()
        self.dropped = self.given = 0  # samples, before and after resampling

    def take(self, samples: Any) -> tuple[Tensor, Tensor, Quality]:  # noqa: ANN401
        """Append samples; return what is new at the checkpoint's rate, and the quality so far.

        Args:
            samples: As :meth:`push` takes them.

        Returns:
            Samples (axes, samples) that stay as they are, those after them as if the signal ended
            here, which later ones change, and the quality of all.

        Raises:
            UserError: If they are no such samples.
        """
        self.survey.add(self.push(samples))
        new, ahead = self._resampled()
        self.level = self.level.plus(new)
        target = self.sense.decoder.sampling_rate
        measures = {"level": self.level.plus(ahead).value, "rate": min(self.rate, target)}
        quality = self.survey.quality(self.usual, self.sense.what, measures)
        return torch.from_numpy(new), torch.from_numpy(ahead), quality

    def _resampled(self) -> tuple[Array, Array]:
        kept, (up, down) = self.kept, self.ratio.as_integer_ratio()
        assert kept is not None
        half = REACH * max(up, down) if self.ratio != 1 else 0  # of the filter, in 1 / up samples
        final = max(self.given, (self.samples * up - half - 1) // down + 1)
        target, name = self.sense.decoder.sampling_rate, self.sense.modality
        every = to_rate(kept, self.rate, target, name)[:, self.given - self.dropped * up // down :]
        new, ahead = every[:, : final - self.given].copy(), every[:, final - self.given :].copy()
        self.given = final
        needed = max(0, (final * down - half) // up // down * down)
        self.kept, self.dropped = kept[:, needed - self.dropped :].copy(), needed
        return new, ahead
