"""What the thresholds do to recordings of known and of held-out classes."""

import json
import math

import pytest
from sklearn.metrics import roc_auc_score

from tex_lightning.evaluation.novelty import pool_unknown, unknown_entry
from tex_lightning.evaluation.outcomes import Outcome, read_outcomes, write_outcomes


def outcome(label: str, predicted: str, novelty: float) -> Outcome:
    probabilities = json.dumps({"a": 0.5, "b": 0.5})
    return Outcome(
        {"haptic": f"{label}{novelty}.wav"}, label, predicted, 1.0, 1, 1, 1.0,
        probabilities=probabilities, novelty=novelty,
    )  # fmt: skip


@pytest.fixture
def pooled(tmp_path):
    """Two folds with two known samples each, and an unknown one."""
    known = [[("a", "a", 0.1), ("b", "a", 0.2)], [("a", "a", 0.3), ("b", "b", 0.4)]]
    unknown = [[("c", "a", 0.25)], [("c", "b", 0.9)]]
    for fold in (0, 1):
        folder = tmp_path / str(fold) / "predictions"
        write_outcomes([outcome(*each) for each in unknown[fold]], folder / "haptic_unknown.csv")
    tested = [[outcome(*each) for each in part] for part in known]

    def pool(thresholds, rate):
        folds = {
            tmp_path / str(fold): {"unknown": {"threshold": value}}
            for fold, value in enumerate(thresholds)
        }
        return pool_unknown(folds, tested, "haptic", tmp_path, rate)["unknown"]

    yield pool
    assert len(read_outcomes(tmp_path / "predictions" / "haptic_unknown.csv")) == 2


def test_each_fold_is_judged_by_its_own_threshold(pooled):
    found = pooled([0.15, 0.35], 0.3)
    assert found["false_rejections"] == {"count": 2, "of": 4, "share": 0.5}
    assert found["accepted_unknown"] == {"count": 0, "of": 2, "share": 0.0}
    assert found["threshold"] == 0.25


def test_a_fold_without_a_threshold_gets_that_of_the_samples_of_the_others(pooled):
    found = pooled([None, None], 0.3)  # 0.4 for the first fold, 0.2 for the second
    assert found["threshold"] == pytest.approx(0.3)
    assert found["false_rejections"] == {"count": 2, "of": 4, "share": 0.5}
    assert found["accepted_unknown"] == {"count": 1, "of": 2, "share": 0.5}
    assert pooled([None, 0.5], 0.3)["false_rejections"]["count"] == 0


def test_without_a_threshold_the_areas_alone_are_known(pooled):
    found = pooled([None, None], None)
    assert not {"rate", "threshold", "false_rejections"} & {*found}
    assert (found["classes"], found["samples"], found["auroc"]) == (["c"], 2, 0.5)
    labels, novelties = [0, 0, 0, 0, 1, 1], [0.1, 0.2, 0.3, 0.4, 0.25, 0.9]
    assert found["novelty_auroc"] == pytest.approx(roc_auc_score(labels, novelties))


def test_one_novelty_that_is_not_measured_leaves_no_area():
    known, unknown = [outcome("a", "a", 0.1)], [outcome("c", "a", 0.9), outcome("c", "a", math.nan)]
    assert unknown_entry([(known, unknown[:1], None)], None)["unknown"]["novelty_auroc"] == 1
    assert unknown_entry([(known, unknown, None)], None)["unknown"]["novelty_auroc"] is None
    assert unknown_entry([(known, [], None)], 0.1) == {"unknown": {"rate": 0.1, "threshold": None}}
