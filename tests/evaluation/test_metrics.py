"""Metrics of a test against scikit-learn, and that each is found where the table says."""

import json

import numpy as np
import pytest
from sklearn.metrics import balanced_accuracy_score, f1_score, recall_score, top_k_accuracy_score

from tex_lightning.evaluation.metrics import METRICS, SCORES, class_metrics, figures, told
from tex_lightning.evaluation.outcomes import Outcome

CLASSES = [*"abcdefg"]


def outcomes_of(truth, probabilities):
    return [
        Outcome({"haptic": str(n)}, CLASSES[label], CLASSES[row.argmax()], 1.0, 1, 1, 1.0,
                probabilities=json.dumps(dict(zip(CLASSES, row.tolist(), strict=True))))
        for n, (label, row) in enumerate(zip(truth, probabilities, strict=True))
    ]  # fmt: skip


@pytest.mark.parametrize("tested", [7, 4, 1])
def test_metrics_are_those_of_scikit_learn_also_where_classes_are_not_tested(tested):
    rng = np.random.default_rng(tested)
    truth = rng.integers(0, tested, 60) ** 2 // tested  # some classes have more than others
    probabilities = rng.dirichlet(np.ones(7), 60) + 0.2 * np.eye(7)[truth]
    found = class_metrics(outcomes_of(truth, probabilities))
    labels = probabilities.argmax(axis=1)
    present = np.unique(truth)
    recall = recall_score(truth, labels, average=None, labels=present)
    assert found["recall"] == pytest.approx(
        {CLASSES[label]: share for label, share in zip(present, recall, strict=True)}
    )
    assert found["balanced_accuracy"] == pytest.approx(recall.mean())
    if set(labels) <= set(truth):  # scikit-learn warns of others
        assert found["balanced_accuracy"] == pytest.approx(balanced_accuracy_score(truth, labels))
    assert found["macro_f1"] == pytest.approx(f1_score(truth, labels, average="macro"))
    for k in (2, 3, 5):
        share = top_k_accuracy_score(truth, probabilities, k=k, labels=range(7))
        assert found["top_k_accuracy"][str(k)] == pytest.approx(share)


def test_the_label_is_the_first_of_the_top_classes_whatever_decides():
    probable = json.dumps({"a": 0.5, "b": 0.3, "c": 0.2})
    outcome = Outcome({"haptic": ""}, "a", "b", 1.0, 1, 0, 1.0, probabilities=probable)
    assert class_metrics([outcome])["top_k_accuracy"] == {"2": 1.0}
    other = Outcome({"haptic": ""}, "a", "c", 1.0, 1, 0, 1.0, probabilities=probable)
    assert class_metrics([outcome, other])["top_k_accuracy"] == {"2": 1.0}
    last = Outcome({"haptic": ""}, "b", "c", 1.0, 1, 0, 1.0, probabilities=probable)
    assert class_metrics([last])["top_k_accuracy"] == {"2": 0.0}


def test_every_score_of_a_run_is_found_where_the_table_says(bands):
    (entry,) = json.loads((bands / "results.json").read_text())["networks"].values()
    assert [*figures(entry, SCORES)] == [name for name in SCORES if name not in LARGE]
    assert told(entry, ["vote_accuracy", "latency_ms"]).keys() == {"accuracy", "ms/sample"}
    assert all(METRICS[name].told(entry) for name in ("parameters", "macs_per_sample"))
    assert METRICS["val_loss"].told({"val_loss": None}) == ""


LARGE = ("top_3_accuracy", "top_5_accuracy")  # of three classes there are none
