"""Which classes are confused, counted anew."""

import json

import numpy as np
import pytest
from sklearn.metrics import confusion_matrix, recall_score

from tex_lightning.evaluation.confusion import (
    confused_pairs,
    fragment_counts,
    own_pairs,
    recall_by_class,
)
from tex_lightning.evaluation.outcomes import Outcome

CLASSES = ["oak", "pine", "cork", "felt"]


def outcome(label: str, **votes: int) -> Outcome:
    total, winner = sum(votes.values()), max(votes, key=lambda name: votes[name])
    right = votes.get(label, 0)
    shown = json.dumps(votes)
    return Outcome({"haptic": "a.wav"}, label, winner, 1.0, total, right, 1.0, votes=shown)


TOUCH = [
    outcome("oak", oak=3, pine=7), outcome("oak", oak=8, pine=2), outcome("pine", pine=10),
    outcome("cork", cork=6, felt=4),
]  # fmt: skip
SIGHT = [outcome("oak", oak=10), outcome("oak", oak=10), outcome("pine", pine=9, cork=1),
         outcome("cork", cork=2, felt=8)]  # fmt: skip


def test_counts_and_recall_are_those_of_the_fragments_one_by_one():
    true, predicted = [], []
    for each in TOUCH:
        for name, votes in json.loads(each.votes).items():
            true += [each.label] * votes
            predicted += [name] * votes
    counts = fragment_counts(TOUCH, CLASSES)
    theirs = confusion_matrix(true, predicted, labels=CLASSES)
    np.testing.assert_array_equal(counts, theirs)
    recall = recall_by_class(counts)
    assert np.isnan(recall[3])  # nothing of it was tested
    expected = recall_score(true, predicted, labels=CLASSES[:3], average=None)
    np.testing.assert_allclose(recall[:3], expected)


def test_pairs_that_change_labels_come_before_those_that_change_fragments_alone():
    pairs = [(pair.label, pair.predicted, pair.share, pair.samples)
             for pair in confused_pairs(TOUCH, CLASSES)]  # fmt: skip
    assert pairs == [("oak", "pine", pytest.approx(0.45), 1), ("cork", "felt", 0.4, 0)]


def test_of_two_directions_the_worse_one_is_listed():
    both = [outcome("oak", pine=9, oak=1), outcome("pine", oak=6, pine=4)]
    ((label, predicted, share, _),) = confused_pairs(both, CLASSES)
    assert (label, predicted, share) == ("oak", "pine", 0.9)


def test_a_network_has_the_pairs_that_another_one_tells_apart():
    found = own_pairs({"haptic": TOUCH, "visual": SIGHT}, CLASSES)
    named = [(own.network, own.pair.label, own.pair.predicted, own.others) for own in found]
    assert named == [
        ("haptic", "oak", "pine", {"visual": 0.0}),
        ("visual", "cork", "felt", {"haptic": 0.4}),
        ("visual", "pine", "cork", {"haptic": 0.0}),
    ]


def test_a_network_alone_has_none_and_classes_that_it_does_not_know_no_row():
    assert own_pairs({"haptic": TOUCH}, CLASSES) == []
    counts = fragment_counts([outcome("glass", oak=4)], CLASSES)
    assert counts.sum() == 0


def test_a_pair_that_another_network_confuses_the_other_way_round_is_no_pair_of_one_alone():
    def outcome(number: int, label: str, predicted: str) -> Outcome:
        votes = json.dumps({predicted: 4})
        return Outcome({"haptic": str(number)}, label, predicted, 1.0, 4, 0, 1.0, votes=votes)

    touch = [outcome(0, "a", "b"), outcome(1, "a", "a"), outcome(2, "b", "b")]
    sight = [outcome(0, "a", "a"), outcome(1, "a", "a"), outcome(2, "b", "a")]
    (own,) = own_pairs({"touch": touch, "sight": sight}, ["a", "b"])
    assert (own.network, own.others) == ("sight", {"touch": 0.5})
