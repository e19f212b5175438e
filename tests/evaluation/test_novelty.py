"""What the thresholds do to recordings of known and of held-out classes."""

import json

import pytest
from sklearn.metrics import roc_auc_score

from tex_lightning.evaluation.calibration import unknown_auroc
from tex_lightning.evaluation.novelty import pool_unknown
from tex_lightning.evaluation.outcomes import Outcome, read_outcomes, write_outcomes


def outcome(label: str, predicted: str, novelty: float) -> Outcome:
    probabilities = json.dumps({"a": 0.5, "b": 0.5})
    return Outcome(
        {"haptic": f"{label}{novelty}.wav"}, label, predicted, 1.0, 1, 1, 1.0,
        probabilities=probabilities, novelty=novelty,
    )  # fmt: skip


@pytest.fixture
def folds(tmp_path):
    """Two folds with two known samples each, and an unknown one."""
    known = [[("a", "a", 0.1), ("b", "a", 0.2)], [("a", "a", 0.3), ("b", "b", 0.4)]]
    unknown = [[("c", "a", 0.25)], [("c", "b", 0.9)]]
    for fold in (0, 1):
        folder = tmp_path / str(fold) / "predictions"
        write_outcomes([outcome(*each) for each in known[fold]], folder / "haptic.csv")
        write_outcomes([outcome(*each) for each in unknown[fold]], folder / "haptic_unknown.csv")
    return [tmp_path / "0", tmp_path / "1"]


def read(folds):
    return [read_outcomes(fold / "predictions" / "haptic.csv") for fold in folds]


def pooled(folds, thresholds, rate=0.3):
    entries = [{"unknown": {"threshold": value}} for value in thresholds]
    given = dict(zip(folds, entries, strict=True))
    return pool_unknown(given, read(folds), "haptic", folds[0].parent, rate)["unknown"]


def test_each_fold_is_judged_by_its_own_threshold(folds):
    found = pooled(folds, [0.15, 0.35])
    assert found["false_rejections"]["count"] == 2
    assert found["false_rejections"]["of"] == 4
    assert found["accepted_unknown"] is not None
    assert found["accepted_unknown"]["count"] == 0
    assert found["accepted_wrong"]["count"] == 0
    assert found["accepted_wrong"]["of"] == 2
    low, high = found["false_rejections"]["ci95"]
    assert low < 0.5 < high


def test_without_one_the_other_folds_set_it(folds):
    found = pooled(folds, [None, None])  # 0.4 of fold 1 for fold 0, 0.2 of fold 0 for fold 1
    assert found["false_rejections"]["count"] == 2
    assert found["accepted_unknown"]["count"] == 1
    assert found["accepted_wrong"]["count"] == 2  # a known one too
    assert found["threshold"] == pytest.approx(0.3)


def test_without_the_key_areas_alone_are_told(folds):
    found = pooled(folds, [None, None], rate=None)
    assert set(found) == {"classes", "samples", "auroc", "novelty_auroc"}
    labels, novelties = [0, 0, 0, 0, 1, 1], [0.1, 0.2, 0.3, 0.4, 0.25, 0.9]
    assert found["novelty_auroc"] == pytest.approx(roc_auc_score(labels, novelties))


def test_one_fold_without_a_threshold_says_so(folds):
    given = {folds[0]: {}}
    found = pool_unknown(given, read(given), "haptic", folds[0].parent, 0.05)["unknown"]
    assert found["threshold"] is None
    assert "false_rejections" not in found


def test_novelties_that_are_not_known_have_no_area():
    known, unknown = [outcome("a", "a", 0.1)], [outcome("c", "a", float("nan"))]
    assert unknown_auroc(known, unknown)["novelty_auroc"] is None
