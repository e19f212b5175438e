"""Labels of whole, perturbed and wrongly combined recordings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import make_card, trunk_node

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import Recording
from tex_lightning.perturbations.table import perturbations
from tex_lightning.studies.perturbed import PerturbedSystem, Perturber, SystemFold, make_rng

TABLE = perturbations()
MODALITIES = {"haptic": "haptic", "visual": "image", "sound": "sound"}
LABELS = ("a", "b", "c")


class Arrays:
    """A store that makes the recordings up from their file names."""

    decoders = dict.fromkeys(MODALITIES.values(), SignalDecoder(10_000.0, 10_000.0, None, None))

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
        fold = SystemFold(Path("x"), classifier, samples, Arrays(), Perturber(0))
        return PerturbedSystem("mine", card.kind, [fold])

    return system


def test_the_draws_of_a_sample_are_those_of_its_content_and_part(make):
    whole = make("haptic").folds[0].samples[0].recordings["haptic"]
    rows = [whole, *(replace(whole, part=part) for part in ((0, 0.5), (0.5, 1)))]
    assert make_rng(0, "x", whole).random() == make_rng(0, "x", whole).random()
    draws = {make_rng(0, name, row).random() for name in "xy" for row in rows}
    assert len(draws) == 6


@pytest.mark.parametrize("level", ["fc2", "fc3"])
def test_labels_are_those_of_the_classifier_for_the_same_recordings(make, level):
    system = make(*MODALITIES, level=level)
    (fold,) = system.folds
    for perturbation in (None, TABLE["white_noise"], TABLE["jpeg"]):
        labels = []
        for sample in fold.samples:
            rows = sample.recordings
            arrays = {name: fold.store.load(rows[name]) for name in rows}
            if perturbation is not None:
                name = perturbation.modality
                arrays[name] = fold.perturber.perturb(rows[name], fold.store, perturbation, 3)
            tensors = {name: torch.from_numpy(np.array(array)) for name, array in arrays.items()}
            labels.append(fold.classifier.classify(**tensors).label)
        assert system.decide(perturbation, 3) == labels


def test_what_is_too_small_is_refused_and_not_guessed(make, monkeypatch):
    (fold,) = make("haptic", "visual").folds
    load = Arrays.load
    monkeypatch.setattr(Arrays, "load", lambda self, row: load(self, row)[:, :9000])
    assert fold.labels()[0] is None
