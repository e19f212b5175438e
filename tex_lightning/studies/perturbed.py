"""Test systems on perturbed recordings, for ``task=stability``.

A recording is perturbed once for all systems. Each sense computes the scores of a recording once,
even if several samples contain it.
"""

import os
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, StabilityConfig
from tex_lightning.config.keys import choice
from tex_lightning.config.model import FUSION, kind_of
from tex_lightning.core.devices import pick_device, to_cpu
from tex_lightning.core.run_folder import SUFFIX, TRAINS, run_of
from tex_lightning.data.decode import Decoder
from tex_lightning.data.folds import Sample, make_samples
from tex_lightning.data.recordings import MODALITIES, Recording, write_part
from tex_lightning.data.store import Store, fingerprint
from tex_lightning.errors import UserError, nearest
from tex_lightning.evaluation.comparison import mcnemar
from tex_lightning.evaluation.outcomes import wilson_interval
from tex_lightning.evaluation.robustness import StabilityRow
from tex_lightning.inference.engine import accelerate
from tex_lightning.learning.provenance import as_trained
from tex_lightning.perturbations.pixels import Array, Scene
from tex_lightning.perturbations.table import (
    SEVERITIES,
    Perturbation,
    perturbations,
    read_severities,
)
from tex_lightning.report.table import model_label, run_settings
from tex_lightning.studies.dataset import open_test_data
from tex_lightning.studies.description import show_opening
from tex_lightning_runtime.files import expanded

Labels = list[int | None]  # class index of each sample; None for an unusable sample


class PerturbedDataset:
    """Recordings of one modality by one decoder, clean and perturbed.

    Random numbers depend only on the seed, the perturbation and the content of the file, so that
    they are the same for every system and severity. The perturbed recordings of the latest
    perturbation and severity are kept. The rate is that of signals in Hz; 0 for photos.
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
        """Return the recording as decoded."""
        return self.stores[row].load(row)

    def perturbed(self, row: Recording, perturbation: Perturbation, severity: float) -> Array:
        """Return the recording perturbed."""
        if self._now != (perturbation, severity):
            self._now, self._perturbed = (perturbation, severity), {}
        if row not in self._perturbed:
            rng = make_rng(self.seed, perturbation.name, row)
            scene = Scene(rng, self.rate)
            self._perturbed[row] = perturbation.apply(np.array(self.clean(row)), severity, scene)
        return self._perturbed[row]


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
        datasets: Where their recordings are, by modality.
    """

    checkpoint: Path
    classifier: SurfaceClassifier
    samples: list[Sample]
    datasets: Mapping[str, PerturbedDataset]
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
            row, dataset = sample.recordings[sense.modality], self.datasets[sense.modality]
            if perturbation is not None and perturbation.modality == sense.modality:
                known, array = self._perturbed, dataset.perturbed(row, perturbation, severity)
            else:
                known, array = self._clean, dataset.clean(row)
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


TestedCheckpoint = tuple[Path, int | None]  # its test fold is None for the configured one
Datasets = dict[tuple[str, Decoder], PerturbedDataset]  # by modality and how it is decoded


def load_systems(config: Config, *, choose: bool = False) -> list[PerturbedSystem]:
    """Load every system with the test samples of each of its folds.

    Args:
        config: ``stability`` names the systems, ``data`` what they are tested on.
        choose: Whether recordings are divided as each checkpoint was trained. Folds of a
            cross-validation always are: another division has other folds of these numbers.

    Raises:
        UserError: If a folder or checkpoint cannot be used, knows other classes, or was trained on
            what it would be tested on.
    """
    datasets: Datasets = {}
    systems, places = list[PerturbedSystem](), list[str]()
    paths = [expanded(name) for name in config.stability.systems or []]
    homes = _short_paths(paths)
    for path, home in zip(paths, homes, strict=True):
        for checkpoints in _checkpoints(path).values():
            folds = [
                _load(config, file, fold, datasets, choose=choose) for file, fold in checkpoints
            ]
            card = folds[0].classifier.card
            name, label = _names(path, card)
            systems.append(PerturbedSystem(name, card.kind, folds, label))
            places.append(home)
    counts, numbers = Counter(system.name for system in systems), Counter[str]()
    for system, home in zip(systems, places, strict=True):
        numbers[title := system.name] += 1
        if counts[title] > 1:  # those of one name get a number, and readers what it stands for
            system.name = f"{title} ({numbers[title]})"
            system.label += f" ({numbers[title]}: {home})"
    return systems


def _short_paths(paths: Sequence[Path]) -> list[str]:
    """Return paths without the folders that all of them share."""
    whole = [path.absolute() for path in paths]
    shared = os.path.commonpath([path.parent for path in whole]) if whole else ""
    return [path.relative_to(shared).as_posix() for path in whole]


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
                fold.datasets[perturbation.modality].perturbed(row, perturbation, severity)
    return chosen


def _check_modalities(
    path: str, table: Mapping[str, Perturbation], systems: Sequence[PerturbedSystem]
) -> None:
    """Reject a slip in the name of a modality; others may be those of other systems."""
    known = {*MODALITIES, *(name for system in systems for name in system.folds[0].datasets)}
    for name in {kind.modality for kind in table.values()} - known:
        if near := nearest(name, known):
            raise UserError(f"stability.severities={path} has the modality {name}{near}.")


def _checkpoints(path: Path) -> dict[str, list[TestedCheckpoint]]:
    """Return the checkpoints of each kind in a run folder, fold by fold; or the file itself."""
    if path.is_file():
        return {"": [(path, None)]}
    if not path.is_dir():
        raise UserError(f"{path} does not exist; give a run folder or a checkpoint.")
    folds = sorted(
        int(folder.name) for folder in path.glob("folds/[0-9]*") if folder.name.isdecimal()
    )
    homes: list[TestedCheckpoint] = [(path / "folds" / str(fold), fold) for fold in folds]
    checkpoints: dict[str, list[TestedCheckpoint]] = {}
    for home, fold in homes or [(path, None)]:
        for file in sorted(home.glob(f"checkpoints/*{SUFFIX}")):
            checkpoints.setdefault(file.stem, []).append((file, fold))
    if not checkpoints:
        raise UserError(
            f"{path} holds no finished checkpoint (checkpoints/KIND.ckpt or "
            "folds/N/checkpoints/KIND.ckpt); give the folder of a finished run."
        )
    kinds = sorted(checkpoints, key=lambda kind: (kind != FUSION, kind))
    return {kind: checkpoints[kind] for kind in kinds}


def _load(
    config: Config, path: Path, fold: int | None, datasets: Datasets, *, choose: bool
) -> SystemFold:
    """Load a checkpoint and its test samples, and add the recordings to the data sets."""
    loaded = load_classifier(path)
    data = config.data if fold is None else config.on_fold(fold).data
    if choose or fold is not None:
        data = as_trained(data, loaded.card)
    dataset, _ = open_test_data(data, loaded, f"Checkpoint {path}")
    if not datasets:  # the first one's data are shown
        show_opening(data, dataset, ", ".join(config.stability.systems or []))
    samples = make_samples(dataset.recordings, loaded.card.modalities)
    perturbed = {}
    for modality, decoder in dataset.store.decoders.items():
        fresh = PerturbedDataset(getattr(decoder, "sampling_rate", 0.0), config.seed)
        perturbed[modality] = datasets.setdefault((modality, decoder), fresh)
        perturbed[modality].add((sample.recordings[modality] for sample in samples), dataset.store)
    loaded.to(pick_device(config.trainer.accelerator))
    classifier = accelerate(loaded, config.engine).eval()
    return SystemFold(path, classifier, samples, perturbed)


def _names(path: Path, card: Card) -> tuple[str, str]:
    """Return the name of a system, and that for readers: of its model, or of a part of that."""
    settings = run_settings(path if path.is_dir() else run_of(path))
    model = settings.get("model.name") if settings.get("task") in TRAINS else None
    if model and kind_of(settings["model.senses"]) == card.kind:
        return model, model_label(model)
    if baseline := card.baseline.get("name"):
        return baseline, model_label(baseline)
    return card.kind, f"{card.kind} inside {model}" if model else card.kind
