"""task=enroll: classes that a trained network gets."""

import json
import shutil
from dataclasses import replace

import pytest
import torch
from conftest import FEW

import tex_lightning as tl
from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.statistics import FeatureStatistics
from tex_lightning.data.store import fingerprint


@pytest.fixture(scope="module")
def two(run_once, surfaces):
    """A rule on proportions of bands that knows alpha and beta."""
    return run_once(*FEW, "data=folder", f"data.root={surfaces}", "data.hold_out=[gamma]")


@pytest.fixture(scope="module")
def new(surfaces, tmp_path_factory):
    """A folder of gamma alone, three traces of it."""
    root = tmp_path_factory.mktemp("new")
    (root / "gamma/haptic").mkdir(parents=True)
    for number in (3, 5, 8):
        shutil.copy(surfaces / f"gamma/haptic/gamma_{number}.wav", root / "gamma/haptic")
    return root


@pytest.fixture(scope="module")
def three(run_once, two, new):
    return run_once("task=enroll", f"checkpoint={two}", "data=folder", f"data.root={new}")


def test_a_class_is_added_from_its_own_recordings_alone(three, two, surfaces, cli):
    results = json.loads((three / "results.json").read_text())
    network = results["networks"]["haptic"]
    assert results["classes"] == ["alpha", "beta", "gamma"]
    assert results["model"] == json.loads((two / "results.json").read_text())["model"]
    assert network["added"] == {"gamma": {"haptic": 3}}
    assert network["enroll_seconds"] < 10
    for label in ("alpha", "beta", "gamma"):
        file = surfaces / f"{label}/haptic/{label}_0.wav"
        said = json.loads(cli("task=predict", f"checkpoint={three}", f"haptic={file}").out)
        assert said["label"] == label
        assert not said["warnings"]
    old, card = tl.load(two).card, tl.load(three).card
    assert len(card.trained_on["seen"]) == len(old.trained_on["seen"]) + 3
    rows, known = (tl.load(run).classifier.rows["haptic"] for run in (three, two))
    assert rows.labels.tolist() == [*known.labels.tolist(), 2, 2, 2]
    assert len({*rows.groups.tolist()}) == len({*known.groups.tolist()}) + 3
    assert card.temperature == old.temperature
    for name, (low, high) in card.input_ranges["haptic"].items():
        first, last = old.input_ranges["haptic"][name]
        assert low <= first <= last <= high


def test_what_was_added_is_not_tested_on(three, surfaces, new, cli, tmp_path):
    asked = ("task=evaluate", f"checkpoint={three}", "data=folder", f"data.root={surfaces}")
    refused = cli(*asked, "data.test_fold=3", f"hydra.run.dir={tmp_path}/3")
    assert refused.status == 2
    assert "has trained on" in refused.err
    its_own = ("data=folder", f"data.root={new}", f"hydra.run.dir={tmp_path}/new")
    refused = cli("task=evaluate", f"checkpoint={three}", *its_own)
    assert refused.status == 2
    assert "task=enroll has learnt them" in " ".join(refused.err.split())
    tested = cli(*asked, "data.test_fold=0", f"hydra.run.dir={tmp_path}/0")
    assert tested.status == 0, tested.err
    network = json.loads((tmp_path / "0/results.json").read_text())["networks"]["haptic"]
    assert network["correct"] == network["test_samples"] == 3


def test_a_cross_validation_of_the_old_classes_says_nothing_of_more(two, new, cli, tmp_path):
    classifier = load_classifier(two / "checkpoints/haptic.ckpt")
    told = {"correct": 9, "test_samples": 10, "vote_accuracy": 0.9, "vote_ci95": [0.6, 1.0]}
    training = {**classifier.card.training, "crossval": {**told, "folds": 5}}
    classifier.card = replace(classifier.card, training=training)
    classifier.save(tmp_path / "known.ckpt")
    assert tl.load(tmp_path / "known.ckpt").card.training["crossval"]["correct"] == 9
    run = ["task=enroll", f"checkpoint={tmp_path}/known.ckpt", "data=folder", f"data.root={new}"]
    assert cli(*run, f"hydra.run.dir={tmp_path}/run").status == 0
    assert "crossval" not in tl.load(tmp_path / "run").card.training


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["data=folder", "data.root={surfaces}"], "already has alpha, beta, gamma; give"),
        (
            ["data=folder", "data.root={new}", "checkpoint={untrained}/checkpoints/haptic.ckpt"],
            "keeps no statistics of its features",
        ),
        (
            ["data=folder", "data.root={new}", "checkpoint={fusion}"],
            "There are no photos of gamma to learn from",
        ),
    ],
)
def test_what_cannot_be_meant_is_said(
    three, new, fusion, untrained, surfaces, cli, tmp_path, given, said
):
    places = {"surfaces": surfaces, "new": new, "fusion": fusion, "untrained": untrained}
    given = [each.format(**places) for each in given]
    run = tmp_path / "run"
    outcome = cli("task=enroll", f"checkpoint={three}", *given, f"hydra.run.dir={run}")
    assert outcome.status == 2, outcome.err
    assert said in outcome.err
    assert not (run / "checkpoints").exists()


@pytest.fixture(scope="module")
def fusion(untrained, tmp_path_factory):
    """A FusionNet of random weights that knows a, b and c, with statistics of no meaning."""
    classifier = tl.load(untrained).classifier
    labels = torch.arange(9) % 3
    for name, size in zip(classifier.card.sense_names, classifier.fusion.sizes, strict=True):
        rows = torch.rand(9, size, generator=torch.Generator().manual_seed(0))
        classifier.statistics[name] = FeatureStatistics.of(rows, labels, 3)
    path = tmp_path_factory.mktemp("fusion") / "fusion.ckpt"
    classifier.save(path)
    return path


def test_a_fusion_learns_a_class_of_all_its_senses(fusion, surfaces, cli, tmp_path):
    outcome = cli(
        "task=enroll", f"checkpoint={fusion}", "data=folder", f"data.root={surfaces}",
        "data.per_class=2", "data.test_fold=0", f"hydra.run.dir={tmp_path}",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    network = json.loads((tmp_path / "results.json").read_text())["networks"]["fusion"]
    new = ["alpha", "beta", "gamma"]
    assert network["added"] == {name: {"haptic": 2, "image": 2} for name in new}
    model = tl.load(tmp_path)
    seen = model.card.trained_on["seen"]
    tested = {fingerprint(path) for path in surfaces.glob("*/*/*_0.*")}
    assert (len(seen), len(tested), tested & {*seen}) == (12, 6, set())
    assert model.card.classes == ["a", "b", "c", *new]
    haptic, image = surfaces / "gamma/haptic/gamma_9.wav", surfaces / "gamma/image/gamma_9.png"
    assert model.predict(haptic=haptic, image=image).label == "gamma"
    assert model.predict(haptic=haptic).label == "gamma"
    assert model.predict(image=image).label == "gamma"
