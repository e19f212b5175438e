import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import log_loss, roc_auc_score

from tex_lightning.evaluation.calibration import (
    augrc,
    auroc,
    calibration,
    risk_coverage,
    selective,
    unknown_auroc,
)
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.report.figures import calibration_figure, save_figure

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


def test_scores_are_those_of_scikit_learn_and_of_the_definitions(outcomes):
    found = calibration(outcomes, CLASSES)
    table = np.array([[o.class_probabilities[c] for c in CLASSES] for o in outcomes])
    labels = [o.label for o in outcomes]
    assert found["nll"] == pytest.approx(log_loss(labels, table))
    truth = np.array([[c == label for c in CLASSES] for label in labels])
    assert found["brier"] == pytest.approx(((table - truth) ** 2).sum(axis=1).mean())
    confidence = table.max(axis=1)
    right = np.array([o.label == o.predicted for o in outcomes])
    bins = np.ceil(confidence * 15).astype(int)
    gaps = [
        (bins == n).mean() * abs(right[bins == n].mean() - confidence[bins == n].mean())
        for n in np.unique(bins)
    ]
    assert found["ece"] == pytest.approx(sum(gaps), abs=1e-5)


@given(st.lists(st.tuples(st.integers(0, 5), st.booleans()), min_size=2, max_size=40))
def test_the_area_under_generalised_risk_has_its_closed_form(samples):
    """(1 - AUROC) acc (1 - acc) + (1 - acc)^2 / 2 (Traub et al., NeurIPS 2024), ties included."""
    confidence = np.array([level / 5 for level, _ in samples])
    correct = np.array([right for _, right in samples])
    accuracy = correct.mean()
    ranking = roc_auc_score(correct, confidence) if 0 < accuracy < 1 else 1.0
    expected = (1 - ranking) * accuracy * (1 - accuracy) + (1 - accuracy) ** 2 / 2
    assert augrc(confidence, correct) == pytest.approx(expected)
    coverage, wrong = risk_coverage(confidence, correct)
    assert coverage[-1] == 1
    assert wrong[-1] == pytest.approx(1 - accuracy)


def test_rejecting_the_unsure(outcomes):
    found = selective(outcomes, 0.8)
    sure = [o for o in outcomes if max(o.class_probabilities.values()) >= 0.8]
    assert found["coverage"] == len(sure) / len(outcomes)
    right = sum(o.label == o.predicted for o in sure)
    assert found["selective_accuracy"] == pytest.approx(right / len(sure))
    assert selective(outcomes, 1.0)["selective_accuracy"] is None


def test_the_unknown_are_told_by_their_confidence(outcomes):
    flat = [outcome("new", np.array([0.34, 0.33, 0.33]))] * 5
    found = unknown_auroc(outcomes, flat)
    above = [max(o.class_probabilities.values()) for o in outcomes]
    expected = np.mean([(c > 0.34) + 0.5 * (c == 0.34) for c in above])
    assert found["auroc"] == pytest.approx(expected, abs=1e-6)
    assert (found["classes"], found["samples"]) == (["new"], 5)


@given(st.lists(st.tuples(st.integers(0, 5), st.booleans()), min_size=1, max_size=40))
def test_auroc_is_scikit_learns(samples):
    """Ties included, and scores that rounding has pushed out of 0 to 1."""
    sides = [[level / 5 * (1 + 1e-15) for level, side in samples if side == s] for s in (0, 1)]
    if not all(sides):
        assert auroc(*sides) is None
    else:
        levels, target = zip(*samples, strict=True)
        assert auroc(*sides) == pytest.approx(roc_auc_score(target, levels), abs=1e-6)


def test_a_confidence_rounded_beyond_1_is_no_logit():
    rows = [np.array([1 + 2e-16, 0, 0]), np.array([0.6, 0.4, 0]), np.array([0.2, 0.8, 0])]
    found = calibration([outcome("a", row) for row in rows], CLASSES)
    assert found["ece"] == pytest.approx((0.0 + 0.4 + 0.8) / 3, abs=1e-6)


def test_the_figure_is_drawn(outcomes, tmp_path):
    save_figure(calibration_figure(outcomes, "t"), tmp_path / "c")
    assert (tmp_path / "c.png").stat().st_size > 5000


def test_probabilities_of_many_classes_are_parsed_but_a_few_times(outcomes, monkeypatch):
    parsed = []

    def noted(text):
        parsed.append(text)
        return json.JSONDecoder().decode(text)

    monkeypatch.setattr(json, "loads", noted)
    calibration(outcomes, CLASSES)
    assert len(parsed) <= 3 * len(outcomes)  # once for each class was cubic in their number
