"""Specimens without end: piece after piece of many materials, rendered when they are asked for.

A specimen is a function of the seed and its number alone: whichever process needs one makes the
same, and nothing is written to disk.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tex_lightning.data.decode import DecodeSettings, halve
from tex_lightning.data.rates import SourceRate
from tex_lightning.data.recordings import Modality, Recording, Recordings
from tex_lightning.data.store import Store
from tex_lightning.synthetic.dataset import SyntheticSpec, photograph, record
from tex_lightning.synthetic.materials import Material, another_piece, distinct_materials
from tex_lightning.synthetic.specimen import Specimen

_PIECE, _ORDER = 2, 3  # apart from the draws of a trace and of a photo
_POINTS = 512  # of a specimen's tiles: 31 mm, which repeat in a stroke; a quarter of the work
_UNSEEN = 1 << 32  # rounds after which specimens are for tests; no training gets there


@dataclass(frozen=True)
class SpecimenGenerator:
    """Numbered specimens, of which every round holds each class once, in an order of its own.

    Attributes:
        spec: Number of classes, recordings of each specimen, their size, and the seed.
        modality: What is recorded; classes are those that this sense can tell apart.
        settings: How recordings are decoded; of rendered ones, whether photos are halved.
    """

    spec: SyntheticSpec
    modality: Modality
    settings: DecodeSettings

    @cached_property
    def materials(self) -> list[Material]:
        """One for each class."""
        return distinct_materials(self.spec.classes, self.spec.seed, self.modality)

    @property
    def classes(self) -> list[str]:
        """Names of the classes, in order."""
        return [material.name for material in self.materials]

    def class_of(self, number: int) -> int:
        """The class of specimen ``number``, which is not negative."""
        turn, place = divmod(number, self.spec.classes)
        order = np.random.default_rng([self.spec.seed, turn, 0, _ORDER])
        return int(order.permutation(self.spec.classes)[place])

    def render(self, number: int, recordings: int | None = None) -> list[NDArray[Any]]:
        """Record specimen ``number``.

        Args:
            number: Not negative.
            recordings: How many; None takes as many as ``spec`` says.

        Returns:
            Traces (3, samples) float32 in g at 10 kHz, or photos (height, width, 3) uint8.
        """
        rng = np.random.default_rng([self.spec.seed, number, 0, _PIECE])
        material = another_piece(self.materials[self.class_of(number)], rng)
        specimen = Specimen(material, _POINTS)
        places = range(self.spec.recordings if recordings is None else recordings)
        if self.modality == "haptic":
            return [record(self.spec, specimen, number, place) for place in places]
        photos = [photograph(self.spec, specimen, number, place) for place in places]
        return [halve(photo) for photo in photos] if self.settings.half_scale else photos

    def unseen(self, count: int) -> Recordings:
        """``count`` specimens that no training meets, one recording of each, to be tested on.

        There are no files: :class:`RenderedStore` makes them from the number in ``group``.
        """
        first = _UNSEEN * self.spec.classes
        rows = []
        for number in range(first, first + count):
            label = self.classes[self.class_of(number)]
            path = Path("synthetic") / label / str(number)
            rows.append(Recording(label, self.modality, path, number))
        return Recordings(tuple(rows))


class RenderedStore(Store):
    """Hands out the recordings of :meth:`SpecimenGenerator.unseen`, rendered each time."""

    def __init__(self, stream: SpecimenGenerator) -> None:
        self.settings = stream.settings
        self.stream = stream

    def rate(self, recording: Recording) -> SourceRate:
        """The rate that traces are rendered at."""
        return SourceRate(self.settings.sampling_rate, "stated")

    def _get(self, recording: Recording) -> NDArray[Any]:
        return self.stream.render(recording.group, 1)[0]
