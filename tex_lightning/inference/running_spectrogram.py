"""The running vote of a network on spectrograms, frame after frame."""

from collections.abc import Sequence

import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import Vote
from tex_lightning.inference.live_rests import MarkedSignal
from tex_lightning.inference.running_vote import RunningVote
from tex_lightning.networks.geometry import padded_positions, reach
from tex_lightning.senses.features.gain import corrected_by
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

PAUSE = 20  # times the seconds in which a gain is told: after a rest as long it is taken as it is


class RunningSpectrogramVote(RunningVote):
    """The running vote of a network whose positions each see a window of a spectrogram.

    Attributes:
        samples: (axes, samples) that no frame was computed of yet.
        frames: Magnitudes (bands, frames) that positions still to come depend on.
        first: Number of the first of these frames.
        corrections: Those of magnitudes by the number of the frame from which on they hold, once
            these are final.
        heard: Magnitudes (bands,) that the first of them was told from.
        cut: Number of samples up to the end of the last movement.
    """

    features: SpectrogramFeatures

    def __init__(self, classifier: SurfaceClassifier) -> None:
        super().__init__(classifier)
        geometry = self.sense.geometry
        assert geometry is not None
        self.windows = geometry.layers[1]
        self.samples: Tensor | None = None
        self.frames: Tensor | None = None
        self.first = self.length = self.cut = 0
        self.corrections: list[tuple[int, Tensor]] = []
        self.heard = torch.zeros(0)
        self.last: Vote | None = None

    def _go_on(self, settled: MarkedSignal, rest: MarkedSignal) -> Vote:
        moving = (~torch.cat((settled.left_out, rest.left_out))).nonzero()
        self.cut = self.length + int(moving[-1]) + 1 if len(moving) else self.cut
        self.length += settled.signal.shape[1]
        signals = settled.signal if self.samples is None else (self.samples, settled.signal)
        samples = torch.cat(signals, dim=1) if isinstance(signals, tuple) else signals
        frames = self._appended(self.frames, samples)
        done = self.features.frames(samples.shape[1])
        self.samples = samples[:, done * self.features.hop_length :].clone()
        every = self._appended(frames, torch.cat((self.samples, rest.signal), dim=1))
        return self._voted(frames, every)

    def _appended(self, frames: Tensor | None, samples: Tensor) -> Tensor:
        """Return frames (bands, frames) with those of further samples (axes, samples)."""
        known = samples.new_zeros(self.features.bands, 0) if frames is None else frames
        if not self.features.frames(samples.shape[1]):
            return known
        return torch.cat((known, self.features.spectra(samples)), dim=-1)

    def _voted(self, settled: Tensor, every: Tensor) -> Vote:
        """Vote by all frames up to the cut, and add the positions that see only final frames."""
        end, stride, added = self.features.frames(self.cut), self.sense.stride, self.count
        skip = added - self.first // stride
        embedding: Tensor | None = None
        corrections, final = self._corrections(
            every[:, : end - self.first], self.first + settled.shape[1]
        )
        if not added or reach(self.windows, added) <= end:  # else the tool rests since then
            embedding = self._embedded(every[:, : end - self.first], corrections)[:, skip:]
            self.last = self._vote(embedding)
        last = self.first + settled.shape[-1]
        count = (last - reach(self.windows, 1)) // stride + 1
        if final and count > added:
            if embedding is None or reach(self.windows, count) > end:
                embedding = self._embedded(settled, corrections)[:, skip:]
            self._add(embedding[:, : count - added])
            first = max(0, count - padded_positions(self.windows)) * stride
            settled, self.first = settled[..., first - self.first :].clone(), first
        self.frames = settled
        assert self.last is not None
        return self.last

    def _corrections(self, moved: Tensor, length: int) -> tuple[list[tuple[int, Tensor]], bool]:
        """Return corrections by the first frame that has each, and whether they are final.

        Args:
            moved: Magnitudes (bands, frames) up to the end of the movement.
            length: Number of all final frames; after a long rest they are taken as they are.
        """
        known, corrections = self.features.known_gain, self.corrections
        end = self.first + moved.shape[1]
        if len(corrections) == 2 or not known.in_use:
            return corrections, True
        if not corrections:
            self.heard = known.heard(moved)
            corrections = [(0, known.correction(self.heard))]
        loud = known.after_rest(moved, self.heard)
        loud[: max(0, known.frames - self.first)] = False
        if loud.any():
            turn = loud.int().argmax()
            heard = known.heard_from(moved, turn)
            corrections = [*corrections, (self.first + int(turn), known.correction(heard))]
        rested = length > end + PAUSE * known.frames
        if rested or end >= corrections[-1][0] + known.frames:
            self.corrections = corrections
        return corrections, len(corrections) == len(self.corrections)

    def _embedded(self, magnitudes: Tensor, corrections: Sequence[tuple[int, Tensor]]) -> Tensor:
        """Return the embedding (D, positions) of magnitudes (bands, frames)."""
        corrected = magnitudes.clone()
        for begin, correction in corrections:
            place = max(0, begin - self.first)
            corrected[:, place:] = corrected_by(correction, magnitudes[:, place:])
        return self._embedding(self.features.normalise(corrected)[None, None])
