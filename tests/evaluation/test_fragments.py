import json

import numpy as np
from sklearn.metrics import confusion_matrix

from tex_lightning.evaluation.outcomes import Outcome, confused_pairs, fragment_counts

CLASSES = ["a", "b", "c"]


def outcome(label: str, votes: dict[str, int]) -> Outcome:
    return Outcome({}, label, "a", 1.0, sum(votes.values()), 0, 1.0, json.dumps(votes))


def test_counts_agree_with_scikit_learn():
    outcomes = [outcome("a", {"a": 3, "c": 2}), outcome("c", {"b": 4}), outcome("a", {"b": 1})]
    labels, predicted = [], []
    for item in outcomes:
        for name, count in item.fragment_votes.items():
            labels += [item.label] * count
            predicted += [name] * count
    theirs = confusion_matrix(labels, predicted, labels=CLASSES)
    np.testing.assert_array_equal(fragment_counts(outcomes, CLASSES), theirs)


def test_pairs_are_those_that_one_sense_alone_confuses():
    haptic = np.array([[6, 4, 0], [2, 8, 0], [0, 0, 10]])  # a and b feel alike
    visual = np.array([[10, 0, 0], [0, 5, 5], [0, 5, 5]])  # b and c look alike
    first, second = confused_pairs({"haptic": haptic, "visual": visual}, CLASSES)
    assert (first.classes, first.confused_by) == (("a", "b"), "haptic")
    assert (first.separated_by, first.other) == ("visual", 0.0)
    assert np.isclose(first.confusion, 0.3)  # mean of 4/10 and 2/10
    assert (second.classes, second.confused_by) == (("b", "c"), "visual")


def test_pairs_that_both_confuse_say_nothing():
    both = np.array([[5, 5], [5, 5]])
    assert confused_pairs({"haptic": both, "visual": both}, ["a", "b"]) == []


def test_of_three_senses_the_one_that_separates_best_is_named():
    shares = {"haptic": 5, "visual": 2, "sound": 1}
    counts = {name: np.array([[10 - n, n], [n, 10 - n]]) for name, n in shares.items()}
    first, second = confused_pairs(counts, ["a", "b"])
    assert (first.confused_by, first.confusion) == ("haptic", 0.5)
    assert (second.confused_by, second.confusion) == ("visual", 0.2)
    assert first.separated_by == second.separated_by == "sound"
