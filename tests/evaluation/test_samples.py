import json
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tex_lightning.classifier.vote import Vote
from tex_lightning.data.folds import Sample
from tex_lightning.evaluation.calibration import calibration
from tex_lightning.evaluation.outcomes import KEPT_CLASSES, Outcome
from tex_lightning.evaluation.samples import kept_probabilities, run_test


def test_the_most_probable_classes_and_those_asked_for_are_kept():
    values = torch.arange(300, dtype=torch.float64) / 300
    known = json.loads(kept_probabilities(values, [f"m{at}" for at in range(300)], {3, 299}))
    assert known == {f"m{at}": at / 300 for at in (3, *range(300 - KEPT_CLASSES, 300))}


def test_all_of_few_classes_are_kept():
    known = kept_probabilities(torch.tensor([0.25, 0.5, 0.25]), ["b", "a", "c"], {0})
    assert list(json.loads(known).items()) == [("b", 0.25), ("a", 0.5), ("c", 0.25)]


@pytest.mark.parametrize(("classes", "least"), [(KEPT_CLASSES, 0), (1000, -0.01)])
def test_brier_score_of_what_is_kept(classes, least):
    names, rng = [f"m{at}" for at in range(classes)], np.random.default_rng(0)
    outcomes, scores = [], []
    for probabilities in rng.dirichlet(np.full(classes, 0.3), 40):
        truth, won = int(rng.integers(classes)), int(probabilities.argmax())
        kept = kept_probabilities(torch.from_numpy(probabilities), names, {truth, won})
        outcomes.append(Outcome({}, names[truth], names[won], 1.0, 1, 1, 1.0, probabilities=kept))
        scores.append(((probabilities - (np.arange(classes) == truth)) ** 2).sum())
    error = calibration(outcomes, names)["brier"] - np.mean(scores)
    assert least - 1e-12 <= error <= 1e-12


def test_brier_score_is_exact_where_what_is_left_is_even():
    names, even = [f"m{at}" for at in range(1000)], np.full(1000, 1e-3)
    kept = kept_probabilities(torch.from_numpy(even), names, {7})
    outcome = Outcome({}, "m7", "m7", 1.0, 1, 1, 1.0, probabilities=kept)
    expected = ((even - (np.arange(1000) == 7)) ** 2).sum()
    assert calibration([outcome], names)["brier"] == pytest.approx(expected, abs=1e-12)


def test_a_tested_sample_keeps_its_true_class_however_improbable(monkeypatch):
    names, values = [f"m{at}" for at in range(200)], torch.arange(200, 0, -1).double()
    vote = Vote(0, torch.eye(200)[0], torch.tensor([0]), values / values.sum())
    classifier = SimpleNamespace(
        card=SimpleNamespace(classes=names), device=torch.device("cpu"), classify=lambda: vote
    )
    (outcome,) = run_test(classifier, [Sample("m199", {})], None)
    assert outcome.class_probabilities["m199"] == pytest.approx(1 / 20_100)
    assert calibration([outcome], names)["nll"] == pytest.approx(np.log(20_100))
