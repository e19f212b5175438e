"""Test systems on perturbed recordings, for ``task=stability``.

A recording is perturbed once for all systems. Each sense computes the scores of a recording once,
even if several samples contain it.
"""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import StabilityConfig
from tex_lightning.config.keys import choice
from tex_lightning.core.devices import to_cpu
from tex_lightning.core.progress import Stage
from tex_lightning.data.decode import Decoder
from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import MODALITIES, Recording, write_part
from tex_lightning.data.store import Store, fingerprint
from tex_lightning.errors import UserError, nearest
from tex_lightning.evaluation.comparison import mcnemar
from tex_lightning.evaluation.outcomes import counted, wilson_interval
from tex_lightning.evaluation.robustness import StabilityRow
from tex_lightning.perturbations.pixels import Array, Scene
from tex_lightning.perturbations.table import (
    SEVERITIES,
    Perturbation,
    perturbations,
    read_severities,
)

Labels = list[int | None]  # class index of each sample; None for an unusable sample


class Perturber:
    """Recordings at one severity of one perturbation after the other, made once for all systems.

    Random numbers depend only on the seed, the perturbation and the content of the file, so that
    they are the same for every system and severity.
    """

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self._now: tuple[Perturbation, float] | None = None
        self._perturbed: dict[tuple[Recording, Decoder], Array] = {}

    def perturb(
        self, row: Recording, store: Store, perturbation: Perturbation, severity: float
    ) -> Array:
        """Return a recording of a store perturbed."""
        if self._now != (perturbation, severity):
            self._now, self._perturbed = (perturbation, severity), {}
        decoder = store.decoders[row.modality]
        if (row, decoder) not in self._perturbed:
            rng = make_rng(self.seed, perturbation.name, row)
            scene = Scene(rng, getattr(decoder, "sampling_rate", 0.0))
            clean = np.array(store.load(row))
            self._perturbed[row, decoder] = perturbation.apply(clean, severity, scene)
        return self._perturbed[row, decoder]


def make_rng(seed: int, name: str, row: Recording) -> np.random.Generator:
    """Return the generator of one recording under one perturbation."""
    identity = [int(fingerprint(row.path), 16)]
    if row.part:
        identity.append(zlib.crc32(write_part(row.part).encode()))
    return np.random.default_rng([seed, zlib.crc32(name.encode()), *identity])


@dataclass
class SystemFold:
    """One classifier and its test samples.

    Attributes:
        checkpoint: Where it was loaded from.
        classifier: In evaluation mode, as prediction runs it.
        samples: Test samples, which it was not trained on.
        store: Their recordings as the classifier takes them.
        perturber: What perturbs them for all systems.
    """

    checkpoint: Path
    classifier: SurfaceClassifier
    samples: list[Sample]
    store: Store
    perturber: Perturber
    _clean: dict[tuple[str, Recording], Tensor] = field(default_factory=dict)
    _perturbed: dict[tuple[str, Recording], Tensor] = field(default_factory=dict)

    def labels(self, perturbation: Perturbation | None = None, severity: float = 0) -> Labels:
        """Return the labels of the samples, clean or perturbed; None for an unusable one.

        The CPU waits for the scores of all of them at once.
        """
        self._perturbed = {}
        scores = [self._scores(sample, perturbation, severity) for sample in self.samples]
        usable = iter(to_cpu([x for x in scores if x is not None]))
        decide, temperature = self.classifier.decide, self.classifier.card.temperature
        return [None if x is None else decide(next(usable), temperature).label for x in scores]

    @torch.inference_mode()
    def _scores(
        self, sample: Sample, perturbation: Perturbation | None, severity: float
    ) -> Tensor | None:
        """Return the class scores of a sample; None for an unusable one."""
        classifier, recordings, partials = self.classifier, {}, []
        for name, sense in classifier.senses.items():
            row = sample.recordings[sense.modality]
            if perturbation is not None and perturbation.modality == sense.modality:
                known = self._perturbed
                array = self.perturber.perturb(row, self.store, perturbation, severity)
            else:
                known, array = self._clean, self.store.load(row)
            recordings[sense.modality] = torch.from_numpy(np.array(array))
            if (name, row) not in known:
                try:
                    scores = classifier.partial_logits(name, recordings[sense.modality])
                except UserError:
                    return None
                known[name, row] = scores
            partials.append(known[name, row])
        return classifier.fuse(partials, classifier.seed(**recordings))


@dataclass
class PerturbedSystem:
    """A system that is tested: a checkpoint, or one for each tested fold.

    Name and label, which is for readers, are unique; its kind is its sense, or ``fusion``.
    """

    name: str
    kind: str
    folds: list[SystemFold]
    label: str = ""

    @property
    def labels(self) -> list[int]:
        """True class of every sample as an index of the classes of its classifier."""
        return [
            fold.classifier.card.classes.index(sample.label)
            for fold in self.folds
            for sample in fold.samples
        ]

    @property
    def chance(self) -> float:
        """Accuracy of guessing among the classes that it knows."""
        return 1 / len(self.folds[0].classifier.card.classes)

    @cached_property
    def clean(self) -> Labels:
        """Labels of all samples as they are."""
        return self.decide()

    def decide(self, perturbation: Perturbation | None = None, severity: float = 0) -> Labels:
        """Return the labels of all samples, fold by fold."""
        return [label for fold in self.folds for label in fold.labels(perturbation, severity)]

    def meets(self, perturbation: Perturbation) -> bool:
        """Return whether the system uses the modality of the perturbation."""
        return perturbation.modality in self.folds[0].classifier.card.modalities


def run_trial(system: PerturbedSystem, perturbation: Perturbation, severity: float) -> StabilityRow:
    """Test a system at one severity; an unusable sample counts as an error."""
    clean = system.clean
    labels = system.decide(perturbation, severity) if severity else clean
    count = len(labels)
    known, right = (
        [label == truth for label, truth in zip(given, system.labels, strict=True)]
        for given in (clean, labels)
    )
    lost, gained, _ = mcnemar(known, right)
    flips = sum(label != before for label, before in zip(labels, clean, strict=True))
    low, high = wilson_interval(sum(right), count)
    return StabilityRow(
        system.name, perturbation.modality, perturbation.name, severity, count, sum(right) / count,
        low, high, flips / count, lost, gained,
    )  # fmt: skip


def run_trials(
    systems: Sequence[PerturbedSystem], chosen: Sequence[Perturbation]
) -> list[StabilityRow]:
    """Run all severities of all perturbations."""
    trials = []
    with Stage("perturbation", len(chosen)) as level:
        for number, perturbation in enumerate(chosen):
            level.update(number, notes=[perturbation.name])
            affected = [system for system in systems if system.meets(perturbation)]
            for severity in (0, *SEVERITIES):  # a perturbed recording serves all systems
                trials += [run_trial(system, perturbation, severity) for system in affected]
    return trials


def system_entry(system: PerturbedSystem, trials: Sequence[StabilityRow]) -> dict[str, Any]:
    """Return the entry of one system in ``results.json``."""
    rows = [trial for trial in trials if trial.system == system.name]
    entry: dict[str, Any] = {
        "name": system.label,
        "kind": system.kind,
        "chance": system.chance,
        "checkpoints": [str(fold.checkpoint) for fold in system.folds],
    }
    if not rows:
        return entry
    perturbed, clean = [trial for trial in rows if trial.severity > 0], rows[0]
    return {
        **entry,
        "clean": counted(round(clean.vote_accuracy * clean.test_samples), clean.test_samples),
        "mean_error": fmean(1 - trial.vote_accuracy for trial in perturbed),
        "mean_flip_rate": fmean(trial.flip_rate for trial in perturbed),
    }


def choose_perturbations(
    systems: Sequence[PerturbedSystem], settings: StabilityConfig
) -> list[Perturbation]:
    """Return the requested perturbations of the systems' modalities, after a try of a user's.

    Raises:
        UserError: If a name is unknown, no system meets any, or a table cannot be used.
    """
    known = dict(perturbations())
    for path in settings.severities:
        table = read_severities(path)
        known |= table
        _check_modalities(path, table, systems)
    for name in settings.only or ():
        if complaint := next(choice("stability.only", name, tuple(known)), None):
            raise UserError(f"{complaint}.")
    asked = [known[name] for name in settings.only or known]
    chosen = [
        perturbation
        for perturbation in asked
        if any(system.meets(perturbation) for system in systems)
    ]
    if not chosen:
        names = ", ".join(perturbation.name for perturbation in asked)
        raise UserError(
            f"No system uses the modality of {names}; change stability.only or systems."
        )
    for perturbation in chosen:
        if perturbation.is_users:
            fold = next(system for system in systems if system.meets(perturbation)).folds[0]
            row = fold.samples[0].recordings[perturbation.modality]
            for severity in (SEVERITIES[0], SEVERITIES[-1]):
                fold.perturber.perturb(row, fold.store, perturbation, severity)
    return chosen


def _check_modalities(
    path: str, table: Mapping[str, Perturbation], systems: Sequence[PerturbedSystem]
) -> None:
    """Reject a slip in the name of a modality; others may be those of other systems."""
    known = {*MODALITIES, *(name for it in systems for name in it.folds[0].store.decoders)}
    for name in {kind.modality for kind in table.values()} - known:
        if near := nearest(name, known):
            raise UserError(f"stability.severities={path} has the modality {name}{near}.")
