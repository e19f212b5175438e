import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import accuracy_score, confusion_matrix

from tex_lightning.classifier.vote import Vote
from tex_lightning.data.folds import Sample
from tex_lightning.evaluation.confusion import vote_counts
from tex_lightning.evaluation.outcomes import (
    Outcome,
    read_outcomes,
    run_test,
    summarise,
    wilson_interval,
    write_outcomes,
)

CLASSES = ["a", "b", "c"]
LABELS = st.lists(st.tuples(st.sampled_from(CLASSES), st.sampled_from(CLASSES)), min_size=1)


def outcome(label: str, predicted: str, fragments: int = 4, right: int = 2) -> Outcome:
    files = {"haptic": "x.wav", "sound": "y.wav"}
    return Outcome(files, label, predicted, 0.5, fragments, right, 1.5)


@given(LABELS)
def test_summary_and_confusion_agree_with_scikit_learn(pairs):
    outcomes = [outcome(*pair) for pair in pairs]
    labels, predicted = zip(*pairs, strict=True)
    assert summarise(outcomes)["vote_accuracy"] == accuracy_score(labels, predicted)
    theirs = confusion_matrix(labels, predicted, labels=CLASSES)
    np.testing.assert_array_equal(vote_counts(outcomes, CLASSES), theirs)


@pytest.mark.parametrize(
    ("correct", "low", "high"), [(682, 0.977, 0.994), (679, 0.972, 0.991), (628, 0.886, 0.929)]
)
def test_wilson_intervals_of_the_papers_690_pairs(correct, low, high):
    """98.8 %, 98.4 % and 91.0 % of 690, as tabulated with three decimals elsewhere."""
    assert wilson_interval(correct, 690) == pytest.approx([low, high], abs=6e-4)


def test_fragments_are_pooled_over_samples_so_that_long_ones_weigh_more():
    summary = summarise([outcome("a", "a", 10, 9), outcome("b", "a", 30, 3)])
    assert summary["fragment_accuracy"] == 12 / 40
    assert summary["latency_ms"] == {"median": 1.5, "p95": 1.5}


def test_outcomes_survive_a_round_trip(tmp_path):
    known = json.dumps({f"a material with a long name {number}": 1 / 7 for number in range(4000)})
    outcomes = [outcome("a", "b"), outcome('c,"x"', "ü")]
    outcomes = [
        replace(each, novelty=place / 4, probabilities=known) for place, each in enumerate(outcomes)
    ]
    write_outcomes(outcomes, tmp_path / "sub" / "o.csv")
    assert read_outcomes(tmp_path / "sub" / "o.csv") == outcomes


def test_a_tested_sample_of_a_class_that_was_not_trained_is_wrong():
    vote = Vote(0, torch.eye(2)[0], torch.tensor([0, 0, 1]), torch.tensor([0.75, 0.25]))
    classifier = SimpleNamespace(
        card=SimpleNamespace(classes=["a", "b"]), device=torch.device("cpu"), classify=lambda: vote
    )
    outcomes = run_test(classifier, [Sample("a", {}), Sample("z", {})], None)
    assert [(each.predicted, each.correct_fragments) for each in outcomes] == [("a", 2), ("a", 0)]
    assert outcomes[0].class_probabilities == {"a": 0.75, "b": 0.25}
