"""Test recordings, clean or perturbed: each is perturbed once for all systems."""

import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

import numpy as np

from tex_lightning.data.folds import Sample
from tex_lightning.data.parts import write_part
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store, fingerprint
from tex_lightning.perturbations.pixels import Array, Scene
from tex_lightning.perturbations.table import Perturbation


@dataclass
class PerturbedDataset:
    """Decoded recordings of one store, clean and perturbed.

    Everything random depends on the seed, the perturbation and the content of the file alone, so
    that every system and every severity meets the same chances.

    Attributes:
        store: Decoded files.
        seed: Seed of everything random.
        folds: Into how many the recordings are divided; a partner is looked for in the same one.
    """

    store: Store
    seed: int
    folds: int

    def __post_init__(self) -> None:
        self.rows: dict[str, Recording] = {}
        self._fingerprint = cache(lambda path: int(fingerprint(path), 16))
        self._now: tuple[Perturbation, float] | None = None
        self._perturbed: dict[Recording, Array] = {}

    def add(self, rows: Iterable[Recording]) -> None:
        """Add recordings, which may be classified and may serve as partners of others."""
        self.rows.update((row.source, row) for row in rows)

    def clean(self, row: Recording) -> Array:
        """The recording as decoded."""
        return self.store.load(row)

    def perturbed(self, row: Recording, perturbation: Perturbation, severity: float) -> Array:
        """The recording perturbed; those of the latest perturbation and severity are kept."""
        if self._now != (perturbation, severity):
            self._now, self._perturbed = (perturbation, severity), {}
        if row not in self._perturbed:
            rng = self.rng(perturbation.name, row)
            rate = getattr(self.store.decoders[row.modality], "sampling_rate", 0.0)
            scene = Scene(rng, rate, lambda: np.array(self.clean(self.partner(row, rng))))
            self._perturbed[row] = perturbation.apply(np.array(self.clean(row)), severity, scene)
        return self._perturbed[row]

    def rng(self, name: str, *rows: Recording) -> np.random.Generator:
        """The generator of one sample under one perturbation."""
        prints = [self._fingerprint(row.path) for row in rows]
        prints += [zlib.crc32(write_part(row.part).encode()) for row in rows if row.part]
        return np.random.default_rng([self.seed, zlib.crc32(name.encode()), *prints])

    def partner(self, row: Recording, rng: np.random.Generator) -> Recording:
        """A recording of the same modality and another class, of the same fold if there is one."""
        others = [
            other
            for _, other in sorted(self.rows.items())
            if other.modality == row.modality and other.label != row.label
        ]
        near = [other for other in others if (other.group - row.group) % self.folds == 0]
        choice = near or others
        return choice[int(rng.integers(len(choice)))]

    def axes(self, samples: Iterable[Sample], modality: str) -> set[int]:
        """Numbers of axes that the signals of some samples have."""
        return {len(self.clean(each.recordings[modality])) for each in samples}
