import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import brier_score_loss, log_loss, roc_auc_score

from tex_lightning.evaluation.calibration import auroc, calibration
from tex_lightning.evaluation.outcomes import Outcome

CLASSES = ["a", "b", "c"]


def outcome(label: str, probabilities: np.ndarray) -> Outcome:
    named = dict(zip(CLASSES, probabilities.tolist(), strict=True))
    predicted = CLASSES[int(probabilities.argmax())]
    return Outcome({}, label, predicted, 1.0, 1, 1, 1.0, probabilities=json.dumps(named))


@pytest.fixture(scope="module")
def outcomes() -> list[Outcome]:
    rng = np.random.default_rng(0)
    rows = rng.dirichlet(np.ones(3), 300)
    return [outcome(str(rng.choice(CLASSES, p=row)), row) for row in rows]


def test_the_calibration_error_is_that_of_its_definition(outcomes):
    confidence = np.array([max(o.class_probabilities.values()) for o in outcomes])
    correct = np.array([o.label == o.predicted for o in outcomes])
    bins = np.ceil(confidence * 15).astype(int)
    gaps = [
        (bins == n).mean() * abs(correct[bins == n].mean() - confidence[bins == n].mean())
        for n in np.unique(bins)
    ]
    assert calibration(outcomes)["ece"] == pytest.approx(sum(gaps), abs=1e-5)


def test_brier_score_and_likelihood_are_scikit_learns(outcomes):
    labels = [o.label for o in outcomes]
    rows = np.array([[o.class_probabilities[name] for name in CLASSES] for o in outcomes])
    found = calibration(outcomes)
    assert found["nll"] == pytest.approx(log_loss(labels, rows, labels=CLASSES))
    squares = brier_score_loss(labels, rows, labels=CLASSES, scale_by_half=False)
    assert found["brier"] == pytest.approx(squares)


def test_a_true_class_of_probability_0_is_as_bad_as_can_be_counted():
    sure = outcome("a", np.array([0.0, 1.0, 0.0]))
    found = calibration([sure, replace(sure, label="never trained")])
    assert (found["brier"], found["ece"]) == (2.0, 1.0)
    assert found["nll"] == pytest.approx(log_loss(["a"], [[0.0, 1.0, 0.0]], labels=CLASSES))
    assert calibration([outcome("b", np.array([0.0, 1.0, 0.0]))]) == {
        "ece": 0.0, "brier": 0.0, "nll": 0.0
    }  # fmt: skip


@given(st.lists(st.tuples(st.integers(0, 5), st.booleans()), min_size=1, max_size=40))
def test_auroc_is_scikit_learns(samples):
    sides = [[level / 5 for level, side in samples if side == s] for s in (0, 1)]
    if not all(sides):
        assert auroc(*sides) is None
    else:
        levels, target = zip(*samples, strict=True)
        assert auroc(*sides) == pytest.approx(roc_auc_score(target, levels))


def test_a_confidence_rounded_beyond_1_is_no_logit():
    rows = [np.array([1 + 2e-16, 0, 0]), np.array([0.6, 0.4, 0]), np.array([0.2, 0.8, 0])]
    found = calibration([outcome("a", row) for row in rows])
    assert found["ece"] == pytest.approx((0.0 + 0.4 + 0.8) / 3, abs=1e-6)
