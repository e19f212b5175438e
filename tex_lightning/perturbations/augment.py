"""Perturbed recordings to train on."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from tex_lightning.perturbations.pixels import Array, Scene
from tex_lightning.perturbations.table import (
    SEVERITIES,
    Perturbation,
    perturbations,
    signal_perturbations,
)


@dataclass(frozen=True)
class Augmentation:
    """Change a share of the recordings, each by one perturbation at any severity up to the worst.

    Attributes:
        kinds: Perturbations of one modality, drawn evenly.
        share: Share of the recordings that are changed.
        rate: Sampling rate of signals in Hz; photos have none.
    """

    kinds: tuple[Perturbation, ...]
    share: float = 1.0
    rate: float = 0.0

    @classmethod
    def of(
        cls, names: Sequence[str], share: float = 1.0, rate: float = 0.0, modality: str = ""
    ) -> Self | None:
        """The named ones of the package, or of a modality of the user's; None without names."""
        known = {**perturbations(), **signal_perturbations(modality)}
        return cls(tuple(known[name] for name in names), share, rate) if names else None

    def __call__(self, recording: Array, rng: np.random.Generator) -> Array:
        """The recording as it is, or perturbed, which may change its size."""
        if rng.random() >= self.share:
            return recording
        kind = self.kinds[int(rng.integers(len(self.kinds)))]
        severity = SEVERITIES[-1] * float(rng.random())
        return kind.apply(recording, severity, Scene(rng, self.rate, _alone))


def trainable(modality: str, medium: str = "signal") -> tuple[str, ...]:
    """Names of those that may be trained on: not held out, for a signal with any number of axes."""
    generic = signal_perturbations(modality) if medium == "signal" else {}
    return tuple(
        name
        for name, each in {**perturbations(), **generic}.items()
        if each.modality == modality and not each.held_out and each.axes is None
    )


def _alone() -> Array:
    raise LookupError("a perturbation that mixes recordings cannot be trained on")
