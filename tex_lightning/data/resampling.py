"""Resampling of a signal chunk by chunk, equal to :func:`.decode.to_rate` of the whole."""

import math

import numpy as np
import numpy.typing as npt
from scipy.signal import firwin, resample_poly

from tex_lightning.data.decode import Trace, rate_ratio

Samples = npt.NDArray[np.floating]
REACH = 10  # samples of the lower rate that the filter sees on each side, as scipy has it
KAISER = ("kaiser", 5.0)


class Resampler:
    """Resample chunk by chunk with a polyphase filter, keeping the samples that it still needs.

    Args:
        source: Rate in Hz of the samples that come.
        target: Rate in Hz to bring them to.
        name: What they are called in messages.

    Raises:
        UserError: If the rates are too far apart.
    """

    def __init__(self, source: float, target: float, name: str) -> None:
        ratio = rate_ratio(source, target, name)
        self.up, self.down = ratio.numerator, ratio.denominator
        widest = max(self.up, self.down)
        self.half = REACH * widest  # of the filter, in samples of the common multiple of the rates
        self.filter = firwin(2 * self.half + 1, 1 / widest, window=KAISER)
        self.kept: Samples | None = None  # (axes, samples), begins at a multiple of `down`
        self.begin = 0  # of what is kept, in samples that came
        self.given = 0  # samples that were given back

    def push(self, samples: Samples) -> Trace:
        """Take samples (axes, samples); return those at the new rate that no later one changes.

        They lag by ten samples of the lower rate.
        """
        kept = samples if self.kept is None else np.concatenate((self.kept, samples), axis=1)
        came = self.begin + kept.shape[1]
        known = max(self.given, math.ceil((came * self.up - self.half) / self.down))
        found = self._between(kept, known)
        first = max(0, (known * self.down - self.half) // self.up)  # that later ones need
        begin = first // self.down * self.down
        self.kept, self.begin = kept[:, begin - self.begin :].copy(), begin
        return found

    def finish(self) -> Trace | None:
        """Return the last samples, as if silence followed; None if there are none."""
        if self.kept is None:
            return None
        end = math.ceil((self.begin + self.kept.shape[1]) * self.up / self.down)
        return self._between(self.kept, end) if end > self.given else None

    def _between(self, kept: Samples, end: int) -> Trace:
        """Samples of the new rate from those given back before up to ``end``."""
        offset = self.begin // self.down * self.up
        found = np.empty((len(kept), 0))
        if end > self.given:
            found = resample_poly(kept, self.up, self.down, axis=1, window=self.filter)
            found = found[:, self.given - offset : end - offset]
        self.given = end
        return np.ascontiguousarray(found, dtype=np.float32)
