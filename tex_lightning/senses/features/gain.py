"""Another gain or a narrower band of a sensor: told from the spectrum, and taken back.

The level of a signal tells materials apart as long as the sensor is the same. A recording whose
spectrum is that of a training recording, only louder or weaker throughout, was made with another
amplifier or sensitivity, and is brought to that recording's gain. A recording at a lower rate, or
of a sensor that hears less, has nothing in its highest bands; they get the usual magnitude. Both
are told from the first three seconds of movement, so that a stream keeps them; if these turn out to
be a rest, from the first three seconds after it.
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
EMPTY = 0.5  # nepers below all of the training
USUAL = 0.75  # of the magnitude of louder frames is about the mean of logarithms
EDGE = 4  # bands below the empty ones, which a filter weakens


class KnownGain(FittedLater):
    """Brings magnitudes to the gain of the training, and fills bands that have nothing.

    Args:
        frames: Number of frames in which both are told.
        bands: Number of bands of the magnitudes.

    Attributes:
        spectra: Logarithms (recordings, bands) of training recordings; empty changes nothing.
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
        """Return the magnitudes (bands, frames) of a whole recording as the training's are.

        The beginning tells the correction of all frames; but if louder ones show that it was a
        rest, they tell that of what follows.
        """
        if not self.in_use:
            return magnitudes
        numbers = torch.arange(magnitudes.shape[1], device=magnitudes.device)
        beginning = self.heard(magnitudes)
        corrected = corrected_by(self.correction(beginning), magnitudes)
        loud = self.after_rest(magnitudes, beginning) & (numbers >= self.frames)
        if is_at_hand(magnitudes) and not loud.any():
            return corrected
        is_after = loud.cumsum(dim=0) > 0
        after = self.heard_from(magnitudes, (~is_after).sum())
        return torch.where(is_after, corrected_by(self.correction(after), magnitudes), corrected)

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

    def correction(self, heard: Tensor) -> Tensor:
        """Return the factors and additions (2, bands) for magnitudes, of what was heard (bands,).

        The factor brings them to the gain of the most similar training recording; it is 1 unless
        the gain is most of what separates them from all of the training. Empty bands get what that
        recording has there.
        """
        spectrum = _spectrum(heard)
        empty = self._empty(spectrum)
        kept = (~empty).to(spectrum)
        apart = (self.spectra - spectrum) * kept
        gains = (apart.sum(dim=1) / kept.sum())[:, None]
        distances = ((apart - gains) * kept).square().sum(dim=1)  # of their shapes
        nearest = distances.argmin(dim=0, keepdim=True)
        least = apart.square().sum(dim=1).amin(dim=0).clamp_min(torch.finfo().tiny)
        gain = torch.where(distances[nearest] / least < LEFT, gains[nearest, 0].exp(), 1.0)
        usual = USUAL * (self.spectra - gains)[nearest, :].squeeze(0).exp()
        return gain * torch.stack((kept, usual * empty))

    def _empty(self, spectrum: Tensor) -> Tensor:
        """Return which of the highest bands (bands,) have far less than all of the training."""
        lowest = len(spectrum) // 4  # bands, which every recording has
        usual = (self.spectra - self.spectra[:, :lowest].mean(dim=1, keepdim=True)).amin(dim=0)
        heard = spectrum - spectrum[:lowest].mean() > usual - EMPTY
        above = heard.flip(0).cumsum(dim=0).flip(0)  # how many are heard from each band up
        empty = torch.cat((above[EDGE:], above[-1:].expand(EDGE))) == 0
        return empty & (torch.arange(len(empty), device=empty.device) >= lowest)


def corrected_by(correction: Tensor, magnitudes: Tensor) -> Tensor:
    """Return magnitudes (bands, frames) by the factors and additions (2, bands) of a correction."""
    factors, additions = correction[:, :, None].unbind()
    return magnitudes * factors + additions


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
