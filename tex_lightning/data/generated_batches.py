"""Training batches from an endless stream of synthetic specimens.

Rendering a specimen costs more than training on a view of it, so each one stays in use for many
batches. As in :mod:`.datamodule`, a batch is a function of the seed and its number alone.
"""

from dataclasses import dataclass, field
from typing import Any, Protocol

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from tex_lightning.data.banks import WHOLE, SpectrogramBank, mirrored, random_corner
from tex_lightning.data.datamodule import Batch
from tex_lightning.data.generator import SpecimenGenerator
from tex_lightning.features.spectrogram import HapticFeatures

LANES = 8  # of specimens; a batch takes from one lane, so that as many loader processes share them


class Views(Protocol):
    """What becomes of a specimen's recordings, and what of them a batch is given."""

    stream: SpecimenGenerator

    def keep(self, recording: Any) -> Any:  # noqa: ANN401
        """A recording in the form in which it waits for its views."""

    def cut(self, kept: Any, rng: np.random.Generator) -> Batch:  # noqa: ANN401
        """A random view of a recording, without the label."""


@dataclass
class TraceViews:
    """Random sub-samples of spectrograms.

    Attributes:
        stream: Of traces.
        features: On the CPU; fitted before the first view is cut.
        frames: Length of a sub-sample.
    """

    stream: SpecimenGenerator
    features: HapticFeatures
    frames: int

    def keep(self, recording: Any) -> Tensor:  # noqa: ANN401
        """Magnitudes (bands, frames) of a trace (axes, samples)."""
        return self.features.magnitudes(torch.from_numpy(recording))

    def cut(self, kept: Tensor, rng: np.random.Generator) -> Batch:
        """``spectrogram`` (1, bands, frames), normalised; short ones are repeated."""
        bank = SpectrogramBank([self.features.normalise(kept)], self.frames)
        return {"spectrogram": bank.cut(np.zeros(1, np.int64), rng)[0]}


@dataclass
class PhotoViews:
    """Random crops of photos, on any scale from the photo's own to that of the whole photo.

    The scale of the photos that the weights are for is not known; nor is a material's, to the eye.

    Attributes:
        stream: Of photos.
        side: Of a crop in pixels.
        rotation: Largest angle in degrees by which the crop is to be turned.
    """

    stream: SpecimenGenerator
    side: int
    rotation: float

    def keep(self, recording: Any) -> Any:  # noqa: ANN401
        """The photo itself."""
        return recording

    def cut(self, kept: Any, rng: np.random.Generator) -> Batch:  # noqa: ANN401
        """``crop`` (3, side, side) uint8 and ``degrees`` (); small photos are mirrored outwards."""
        rows, columns = kept.shape[:2]
        side = int(rng.integers(self.side, max(self.side, min(rows, columns)) + 1))
        top, left = random_corner(kept, side, rng)
        piece = mirrored(kept[top : top + side, left : left + side], side)
        crop = cv2.resize(piece, (self.side, self.side), interpolation=cv2.INTER_AREA)
        degrees = rng.uniform(-self.rotation, self.rotation)
        pixels = torch.from_numpy(crop).permute(2, 0, 1)
        return {"crop": pixels, "degrees": torch.tensor(degrees, dtype=torch.float32)}


@dataclass
class GeneratedBatches(Dataset[Batch]):
    """Batch number ``i`` of views of a stream of specimens.

    Specimen ``n`` belongs to lane ``n % LANES``, batch ``i`` to lane ``i % LANES``. A batch takes
    one view of each of ``batch_size`` specimens that follow each other in its lane, and the next
    batch of the lane begins so much later that every specimen is viewed ``views`` times. The
    place of a specimen in its batches never changes, so that loader processes as well as processes
    that train together divide the rendering between them.

    Attributes:
        source: What is rendered and how it is cut.
        batch_size: Views in a batch.
        views: How often a specimen is viewed before it is gone.
        seed: Of what is random about the views.
        share: The part of every batch that is handed out.
        waiting: Rendered specimens of each lane, by number.
    """

    source: Views
    batch_size: int
    views: int
    seed: int
    share: slice = field(default_factory=lambda: WHOLE)
    waiting: dict[int, dict[int, list[Any]]] = field(default_factory=dict)

    def specimen(self, number: int) -> list[Any]:
        """The recordings of specimen ``number``, rendered or still waiting."""
        lane = self.waiting.setdefault(number % LANES, {})
        if number not in lane:
            lane[number] = [self.source.keep(each) for each in self.source.stream.render(number)]
        return lane[number]

    def numbers(self, step: int) -> list[int]:
        """Specimens in batch ``step``, place by place, all processes' shares together."""
        turn, lane = divmod(step, LANES)
        first = turn * self.batch_size // self.views
        places = np.arange(self.batch_size)
        return ((first + (places - first) % self.batch_size) * LANES + lane).tolist()

    def __getitem__(self, step: int) -> Batch:
        """Assemble batch ``step``: spectrogram, or crop and degrees, and label."""
        items = [*enumerate(self.numbers(step))][self.share]
        self.waiting[step % LANES] = {number: self.specimen(number) for _, number in items}
        views = [self._view(step, place, number) for place, number in items]
        return {name: torch.stack([view[name] for view in views]) for name in views[0]}

    def _view(self, step: int, place: int, number: int) -> Batch:
        rng = np.random.default_rng([self.seed, step, place])
        recordings = self.specimen(number)
        kept = recordings[int(rng.integers(len(recordings)))]
        label = torch.tensor(self.source.stream.class_of(number))
        return {"label": label, **self.source.cut(kept, rng)}
