"""Labels of whole, perturbed and wrongly combined recordings."""

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import make_card, trunk_node

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import Recording
from tex_lightning.perturbations.table import perturbations
from tex_lightning.studies.perturbed import PerturbedDataset, PerturbedSystem, SystemFold, make_rng

TABLE = perturbations()
MODALITIES = {"haptic": "haptic", "visual": "image", "sound": "sound"}
LABELS = ("a", "b", "c")


class Arrays:
    """A store that makes the recordings up from their file names."""

    def load(self, row: Recording) -> np.ndarray:
        rng = np.random.default_rng(list(row.path.name.encode()))
        if row.modality == "image":
            return rng.integers(0, 256, (240, 260, 3)).astype(np.uint8)
        samples = 24_000 if row.modality == "haptic" else 88_200
        return rng.standard_normal((1, samples)).astype(np.float32)


@pytest.fixture
def make(tmp_path):
    """A system of random weights on two samples of each of three classes."""

    def rows(label: str, group: int, senses) -> dict[str, Recording]:
        made = {}
        for modality in (MODALITIES[sense] for sense in senses):
            path = tmp_path / f"{label}_{group}.{modality}"
            path.write_text(path.name)
            made[modality] = Recording(label, modality, path, group, fold=group)
        return made

    def system(*senses: str, level: str = "fc2") -> PerturbedSystem:
        torch.manual_seed(0)
        card = make_card(*senses, level=level, pairs=200, width=0.1, trunk=trunk_node("tcnn"))
        classifier = SurfaceClassifier(replace(card, calibration={"temperature": 2.0})).eval()
        if len(senses) > 1:
            torch.nn.init.normal_(classifier.fusion.head.weight)
            torch.nn.init.normal_(classifier.fusion.head.bias)
        samples = [Sample(label, rows(label, n, senses)) for label in LABELS for n in (0, 1)]
        datasets = {MODALITIES[sense]: PerturbedDataset(10_000.0, 0) for sense in senses}
        for modality, dataset in datasets.items():
            dataset.add((each.recordings[modality] for each in samples), Arrays())
        fold = SystemFold(Path("x"), classifier, samples, datasets)
        return PerturbedSystem("mine", card.kind, [fold])

    return system


def asked(system: PerturbedSystem, perturbation: str, severity: float, monkeypatch) -> list:
    """The recordings that samples are decided by."""
    given = []

    def label(rows, *_):
        given.append(dict(rows))

    monkeypatch.setattr(system.folds[0], "label", label)
    system.decide(TABLE[perturbation], severity)
    return given


def test_a_system_meets_what_hits_a_modality_that_it_reads_beside_another(make):
    def names(*senses: str) -> set[str]:
        both = (each for each in TABLE.values() if each.modality == "both")
        return {each.name for each in both if make(*senses).meets(each)}

    assert names("haptic") == set()
    either = {"haptic_missing", "image_missing"}
    assert names("haptic", "visual") == either
    assert names(*MODALITIES) == {*either, "sound_missing"}


def test_a_share_lacks_a_modality_that_the_files_decide(make, monkeypatch):
    system, table = make("haptic", "visual"), TABLE["haptic_missing"]
    found = asked(system, "haptic_missing", 2, monkeypatch)
    for rows, sample in zip(found, system.folds[0].samples, strict=True):
        chance = make_rng(0, table.name, *sample.recordings.values()).random()
        assert ("haptic" in rows) == (chance >= table.value(2))


def test_the_draws_of_a_sample_are_those_of_its_content_and_part(make):
    whole = make("haptic").folds[0].samples[0].recordings["haptic"]
    rows = [whole, *(replace(whole, part=part) for part in ((0, 0.5), (0.5, 1)))]
    assert make_rng(0, "x", whole).random() == make_rng(0, "x", whole).random()
    draws = {make_rng(0, name, row).random() for name in "xy" for row in rows}
    assert len(draws) == 6


@pytest.mark.parametrize("level", ["fc2", "fc3"])
def test_any_of_three_senses_decide_as_the_part_of_them(make, level):
    system = make(*MODALITIES, level=level)
    (fold,) = system.folds
    sample, classifier = fold.samples[0], fold.classifier
    tensors = {
        name: torch.from_numpy(np.array(fold.datasets[name].clean(row)))
        for name, row in sample.recordings.items()
    }
    for count in (1, 2, 3):
        for senses in combinations(MODALITIES, count):
            part = {MODALITIES[sense]: tensors[MODALITIES[sense]] for sense in senses}
            rows = {name: sample.recordings[name] for name in part}
            expected = classifier.with_senses(senses).classify(**part).label
            assert fold.label(rows) == expected
    assert system.decide()[0] == classifier.classify(**tensors).label


def test_what_is_too_small_is_refused_and_not_guessed(make, monkeypatch):
    (fold,) = make("haptic", "visual").folds
    load = Arrays.load
    monkeypatch.setattr(Arrays, "load", lambda self, row: load(self, row)[:, :9000])
    assert fold.labels()[0] is None
