import json

import numpy as np
import pytest
import torch

from tex_lightning.evaluation.calibration import calibration
from tex_lightning.evaluation.outcomes import KEPT_CLASSES, Outcome
from tex_lightning.evaluation.samples import kept_probabilities


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
