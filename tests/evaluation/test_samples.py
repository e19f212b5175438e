import json
from types import SimpleNamespace

import pytest
import torch

from tex_lightning.classifier.vote import Vote
from tex_lightning.data.folds import Sample
from tex_lightning.evaluation.outcomes import KEPT_CLASSES
from tex_lightning.evaluation.samples import kept_probabilities, run_test


def test_the_most_probable_classes_and_those_asked_for_are_kept():
    values = torch.arange(300, dtype=torch.float64) / 300
    known = json.loads(kept_probabilities(values, [f"m{at}" for at in range(300)], {3, 299}))
    assert known == {f"m{at}": at / 300 for at in (3, *range(300 - KEPT_CLASSES, 300))}


def test_all_of_few_classes_are_kept():
    known = kept_probabilities(torch.tensor([0.25, 0.5, 0.25]), ["b", "a", "c"], {0})
    assert list(json.loads(known).items()) == [("b", 0.25), ("a", 0.5), ("c", 0.25)]


def test_a_tested_sample_keeps_its_true_class_however_improbable(monkeypatch):
    names, values = [f"m{at}" for at in range(200)], torch.arange(200, 0, -1).double()
    vote = Vote(0, torch.eye(200)[0], torch.tensor([0]), values / values.sum())
    classifier = SimpleNamespace(
        card=SimpleNamespace(classes=names), device=torch.device("cpu"), classify=lambda: vote
    )
    (outcome,) = run_test(classifier, [Sample("m199", {})], None)
    assert outcome.class_probabilities["m199"] == pytest.approx(1 / 20_100)
