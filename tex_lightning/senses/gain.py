"""Another gain of a sensor: told from the spectrum, and taken back.

The level of a signal tells materials apart as long as the sensor is the same. A recording whose
spectrum is that of a training recording, only louder or weaker throughout, was made with another
amplifier or sensitivity, and is brought to that recording's gain. The gain is told from the first
three seconds of movement, so that a stream keeps it; if these turn out to be a rest, from the first
three seconds after it.
"""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.functional import pad

from tex_lightning.core.devices import is_at_hand
from tex_lightning.networks.blocks import FittedLater

SECONDS = 3.0  # of movement, in which a gain is told
MAX_SPECTRA = 1000  # training recordings whose spectra are kept
LEFT = 0.3  # share of the squared distance that a gain may leave, if it is the gain that differs
QUIET = 0.05  # of the magnitude of loud frames; what is quieter is a rest
SUSTAINED = 10  # frames; a rest ends where as many are loud, and not in a knock
STEP = 3  # frames overlap, and every third tells as much
FLOOR = 1e-3  # of the mean magnitude of a spectrum; below it the logarithm is flat
FAINT = 1e-12  # magnitude of a signal without any gain


class KnownGain(FittedLater):
    """Factors by which magnitudes are brought to the gain of the training.

    Args:
        frames: Number of frames in which a gain is told.
        bands: Number of bands of the magnitudes.

    Attributes:
        spectra: Logarithms (recordings, bands) of training recordings; empty leaves every gain.
    """

    spectra: Tensor

    def __init__(self, frames: int, bands: int) -> None:
        super().__init__(spectra=("recordings", bands))
        self.frames = frames

    def fit(self, magnitudes: Sequence[Tensor]) -> None:
        """Take the spectra of training recordings (bands, frames)."""
        some = magnitudes[:: -(-len(magnitudes) // MAX_SPECTRA)]
        self.take({"spectra": torch.stack([_spectrum(self.heard(x)) for x in some])})

    def forward(self, magnitudes: Tensor) -> Tensor:
        """Return the factor of each frame (frames,) of a whole recording (bands, frames)."""
        numbers = torch.arange(magnitudes.shape[1], device=magnitudes.device)
        if not self.in_use:
            return torch.ones_like(numbers, dtype=magnitudes.dtype)
        heard = self.heard(magnitudes)
        gain = self.gain(heard)
        loud = self.after_rest(magnitudes, heard) & (numbers >= self.frames)
        if is_at_hand(magnitudes) and not loud.any():
            return gain.expand(len(numbers))
        later = loud.cumsum(dim=0) > 0
        return torch.where(later, self.gain(self.heard_from(magnitudes, (~later).sum())), gain)

    def heard(self, magnitudes: Tensor) -> Tensor:
        """Return of each band (bands,) what a gain is told from: the beginning's louder frames."""
        return _louder(magnitudes[:, : self.frames])

    def after_rest(self, magnitudes: Tensor, heard: Tensor) -> Tensor:
        """Return at which frames (frames,) it is so loud that what was heard was a rest."""
        loud = magnitudes.mean(dim=0) > heard.mean() / QUIET
        before = pad(loud.cumsum(dim=0), (1, 0))  # loud frames before each, and in all
        after = torch.arange(loud.shape[0], device=loud.device) + SUSTAINED
        return before[after.clamp(max=loud.shape[0])] - before[:-1] == SUSTAINED

    def heard_from(self, magnitudes: Tensor, first: Tensor) -> Tensor:
        """Return the same (bands,) of the frames from a number () on; the last is repeated."""
        places = first + torch.arange(self.frames, device=magnitudes.device)
        return _louder(magnitudes[:, places.clamp(max=magnitudes.shape[1] - 1)])

    def gain(self, heard: Tensor) -> Tensor:
        """Return the factor () that brings what was heard (bands,) to the gain of the most similar.

        It is 1 unless the gain is most of what separates them from all of the training.
        """
        apart = self.spectra - _spectrum(heard)
        gains = apart.mean(dim=1)
        shapes = (apart - gains[:, None]).square().sum(dim=1)
        nearest = shapes.argmin(dim=0, keepdim=True)
        left = shapes[nearest] / apart.square().sum(dim=1).amin(dim=0).clamp_min(torch.finfo().tiny)
        return torch.where(left < LEFT, gains[nearest].exp(), 1.0).squeeze(0)


def _spectrum(heard: Tensor) -> Tensor:
    """Return logarithms (bands,) of magnitudes (bands,), which a gain moves alike."""
    own = heard.mean().clamp_min(FAINT)
    return (heard / own).add(FLOOR).log() + own.log()


def _louder(magnitudes: Tensor) -> Tensor:
    """Return of each band (bands,) the magnitude that 30 % of the frames of movement exceed.

    Neither rests nor knocks change it much.
    """
    some = magnitudes[:, ::STEP]
    frames, last = some.mean(dim=0), some.shape[1] - 1
    moving = frames > QUIET * frames.sort().values[19 * last // 20]
    place = last - 3 * (moving.sum() - 1).clamp_min(0) // 10
    return some.sort(dim=1).values.index_select(1, place[None])[:, 0]
