"""Test samples of a system, as they are or perturbed, and the labels that it gives them.

A recording is perturbed once for all systems. Every sense computes its scores of a recording once,
however many samples it is part of.
"""

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path

import numpy as np
import torch

from tex_lightning.classifier.classifier import SenseOutput, SurfaceClassifier
from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import Recording, write_part
from tex_lightning.data.store import Store, fingerprint
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import wilson_interval
from tex_lightning.perturbations.pixels import Array, Scene
from tex_lightning.perturbations.table import BOTH, Perturbation
from tex_lightning.report.stability_charts import StabilityRow

Labels = list[int | None]  # class index of each sample; None where the classifier refuses it


class PerturbedDataset:
    """Recordings of one modality, decoded in one way, as they are and perturbed.

    Everything random depends on the seed, the perturbation and the content of the file alone, so
    that every system and every severity meets the same chances. The perturbed recordings of the
    latest perturbation and severity are kept.

    Args:
        rate: Sampling rate of signals in Hz; 0 for photos.
        seed: Seed of all that is random.
    """

    def __init__(self, rate: float, seed: int) -> None:
        self.rate, self.seed = rate, seed
        self.stores: dict[Recording, Store] = {}
        self._now: tuple[Perturbation, float] | None = None
        self._perturbed: dict[Recording, Array] = {}

    def add(self, rows: Iterable[Recording], store: Store) -> None:
        """Add recordings of a store."""
        self.stores.update((row, store) for row in rows)

    def clean(self, row: Recording) -> Array:
        """The recording as decoded."""
        return self.stores[row].load(row)

    def perturbed(self, row: Recording, perturbation: Perturbation, severity: float) -> Array:
        """The recording perturbed."""
        if self._now != (perturbation, severity):
            self._now, self._perturbed = (perturbation, severity), {}
        if row not in self._perturbed:
            rng = make_rng(self.seed, perturbation.name, row)
            scene = Scene(rng, self.rate)
            self._perturbed[row] = perturbation.apply(np.array(self.clean(row)), severity, scene)
        return self._perturbed[row]


_fingerprint = cache(fingerprint)


def make_rng(seed: int, name: str, *rows: Recording) -> np.random.Generator:
    """The generator of one sample under one perturbation."""
    prints = [int(_fingerprint(row.path), 16) for row in rows]
    prints += [zlib.crc32(write_part(row.part).encode()) for row in rows if row.part]
    return np.random.default_rng([seed, zlib.crc32(name.encode()), *prints])


@dataclass
class SystemFold:
    """One classifier and its test samples.

    Attributes:
        checkpoint: Where it was loaded from.
        classifier: In evaluation mode, as prediction runs it.
        samples: Those it has not trained on.
        datasets: Where their recordings are, by modality.
    """

    checkpoint: Path
    classifier: SurfaceClassifier
    samples: list[Sample]
    datasets: Mapping[str, PerturbedDataset]
    _parts: dict[tuple[str, ...], SurfaceClassifier] = field(default_factory=dict)
    _clean: dict[tuple[object, ...], SenseOutput] = field(default_factory=dict)
    _perturbed: dict[tuple[object, ...], SenseOutput] = field(default_factory=dict)

    def labels(self, perturbation: Perturbation | None = None, severity: float = 0) -> Labels:
        """Label the samples, as they are or perturbed."""
        self._perturbed = {}
        if perturbation is not None and perturbation.modality == BOTH:
            return [self._lacking(sample, perturbation, severity) for sample in self.samples]
        return [self.label(each.recordings, perturbation, severity) for each in self.samples]

    def _lacking(self, sample: Sample, perturbation: Perturbation, severity: float) -> int | None:
        """Label a sample, a share of which lack a modality."""
        rows = dict(sample.recordings)
        seed = self.datasets[perturbation.lacks].seed
        rng = make_rng(seed, perturbation.name, *rows.values())
        if rng.random() < perturbation.value(severity):
            del rows[perturbation.lacks]
        return self.label(rows)

    @torch.inference_mode()
    def label(
        self,
        rows: Mapping[str, Recording],
        perturbation: Perturbation | None = None,
        severity: float = 0,
    ) -> int | None:
        """Label one sample; senses whose modality is missing are left out.

        Args:
            rows: The recordings, by modality.
            perturbation: Changes those of its modality; None leaves all as they are.
            severity: Severity of the perturbation.
        """
        part = self._part(rows)
        recordings, outputs = {}, {}
        for modality, row in rows.items():
            dataset, changed = self.datasets[modality], self._clean
            if perturbation is not None and perturbation.modality == modality:
                recording, changed = dataset.perturbed(row, perturbation, severity), self._perturbed
            else:
                recording = dataset.clean(row)
            recordings[modality] = torch.from_numpy(np.array(recording))
            for name, sense in part.senses.items():
                key = part.card.sense_names, name, row
                if sense.modality == modality and key not in changed:
                    try:
                        changed[key] = part.sense_output(name, recordings[modality])
                    except UserError:
                        return None
                if sense.modality == modality:
                    outputs[name] = changed[key]
        partials = [outputs[name].partial_logits for name in part.senses]
        scores = part.fuse(partials, part.seed(**recordings))
        return part.decide(scores, part.card.temperature).label

    def _part(self, modalities: Iterable[str]) -> SurfaceClassifier:
        """Return the classifier of the senses whose modalities are there."""
        there, senses = {*modalities}, self.classifier.senses.items()
        names = tuple(name for name, sense in senses if sense.modality in there)
        if names not in self._parts:
            self._parts[names] = self.classifier.with_senses(names)
        return self._parts[names]


@dataclass
class PerturbedSystem:
    """One named line of every table: a checkpoint, or one for each fold that is tested.

    Attributes:
        name: Unlike those of the other systems.
        kind: The sense that it reads, or ``fusion`` of several.
        folds: What is tested.
    """

    name: str
    kind: str
    folds: list[SystemFold]

    @property
    def labels(self) -> list[int]:
        """True class of every sample as an index of the classes of its classifier."""
        return [
            fold.classifier.card.classes.index(sample.label)
            for fold in self.folds
            for sample in fold.samples
        ]

    @cached_property
    def clean(self) -> Labels:
        """Labels of all samples as they are."""
        return self.decide()

    def decide(self, perturbation: Perturbation | None = None, severity: float = 0) -> Labels:
        """Return the labels of all samples, fold by fold."""
        return [label for fold in self.folds for label in fold.labels(perturbation, severity)]

    def meets(self, perturbation: Perturbation) -> bool:
        """Return whether the system reads what the perturbation changes."""
        read = {*self.folds[0].classifier.card.modalities}
        if perturbation.modality != BOTH:
            return perturbation.modality in read
        return perturbation.lacks in read and len(read) > 1


def run_trial(system: PerturbedSystem, perturbation: Perturbation, severity: float) -> StabilityRow:
    """Test a system at one severity; a sample that is refused counts as wrong."""
    clean = system.clean
    labels = system.decide(perturbation, severity) if severity else clean
    count = len(labels)
    correct = sum(label == truth for label, truth in zip(labels, system.labels, strict=True))
    flips = sum(label != before for label, before in zip(labels, clean, strict=True))
    low, high = wilson_interval(correct, count)
    return StabilityRow(
        system.name, perturbation.modality, perturbation.name, severity, count, correct / count,
        low, high, flips / count,
    )  # fmt: skip
