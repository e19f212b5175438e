from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.dummy import DummyClassifier
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid

from tex_lightning.evaluation.choice import (
    Candidate,
    choose_without_each_fold,
    one_standard_error,
    pareto,
    within_budget,
)


def candidate(name: str, cost: float, *folds: str) -> Candidate:
    """Votes by fold, + where they are correct; samples are numbered through all folds."""
    before = [sum(map(len, folds[:fold])) for fold in range(len(folds))]
    return Candidate(
        name, cost, {
            fold: {str(start + i): mark == "+" for i, mark in enumerate(folds[fold])}
            for fold, start in enumerate(before)
        },
    )  # fmt: skip


def test_cheaper_system_with_one_error_more_is_enough():
    """One discordant sample of n: the mean difference is 1/n and so is its standard error."""
    best, small = candidate("best", 10, "+" * 50), candidate("small", 1, "+" * 49 + "-")
    assert one_standard_error([best, small]).name == "small"


def test_cheaper_system_that_is_clearly_worse_is_not_enough():
    best, small = candidate("best", 10, "+" * 50), candidate("small", 1, "+" * 40 + "-" * 10)
    assert one_standard_error([best, small]).name == "best"


def test_pairing_counts_only_what_differs():
    """Equal accuracies of 1/2 on the same samples leave no doubt that one extra error matters."""
    best = candidate("best", 10, "+" * 30 + "-" * 30)
    worse = candidate("worse", 1, "+" * 20 + "-" * 40)
    differences = np.array([1] * 10 + [0] * 50)
    assert differences.mean() > differences.std(ddof=1) / np.sqrt(60)
    assert one_standard_error([best, worse]).name == "best"


def test_dearer_systems_are_never_chosen_for_a_tie():
    pair = [candidate("dear", 2, "++-"), candidate("cheap", 1, "+-+")]
    assert one_standard_error(pair).name == "cheap"


def test_each_fold_is_left_to_the_choice_on_the_others():
    """Cheap is better on the first fold alone, and there alone dear is what the others choose."""
    cheap = candidate("cheap", 1, "+" * 20, "+-" * 10, "+-" * 10)
    dear = candidate("dear", 2, "-" * 20, "+" * 20, "+" * 20)
    assert choose_without_each_fold([cheap, dear]) == {0: "dear", 1: "cheap", 2: "cheap"}


def test_votes_on_a_sample_of_the_fold_are_left_out_of_other_folds_too():
    """With inverted folds a sample is tested in several of them."""
    twice = Candidate("a", 1, {0: {"x": True}, 1: {"x": False, "y": True}})
    assert twice.without(0).votes == {1: {"y": True}}


def test_one_fold_leaves_nothing_to_choose_on():
    assert choose_without_each_fold([candidate("a", 1, "+-"), candidate("b", 2, "++")]) == {}


FOLDS, LABELS = np.repeat(np.arange(5), 8), np.tile([0, 1], 20)  # either class in every fold


def votes_on_noise(make, features) -> dict[int, dict[str, bool]]:
    """Correct votes of a scikit-learn classifier cross-validated on labels that mean nothing."""
    votes = {}
    for fold in range(5):
        test = np.equal(FOLDS, fold)
        predicted = make().fit(features[~test], LABELS[~test]).predict(features[test])
        correct = predicted == LABELS[test]
        votes[fold] = dict(zip(map(str, np.flatnonzero(test)), correct, strict=True))
    return votes


def accuracies_on_noise(makers, repetitions: int) -> tuple[np.ndarray, np.ndarray]:
    """Accuracy of the system chosen on all votes, and of choosing without each fold's votes."""
    chosen, procedure = [], []
    for seed in range(repetitions):
        rng = np.random.default_rng(seed)
        features = [rng.standard_normal((40, 3)) for _ in makers]  # of its own for each system
        family = [
            Candidate(str(cost), cost, votes_on_noise(partial(make, rng), features[cost]))
            for cost, make in enumerate(makers)
        ]
        chosen.append(one_standard_error(family).accuracy)
        left = {item.name: item.votes for item in family}
        choices = choose_without_each_fold(family).items()
        procedure.append(np.mean([v for fold, name in choices for v in left[name][fold].values()]))
    return np.array(chosen), np.array(procedure)


def error(values: np.ndarray) -> float:
    return values.std(ddof=1) / np.sqrt(len(values))


def guesser(rng) -> DummyClassifier:
    return DummyClassifier(strategy="uniform", random_state=int(rng.integers(10_000)))


def test_choosing_among_guessers_is_as_good_as_guessing():
    """What was chosen seems better on the votes that it was chosen on."""
    chosen, procedure = accuracies_on_noise([guesser] * 6, 60)
    assert abs(procedure.mean() - 0.5) < 3 * error(procedure)
    assert chosen.mean() > 0.5 + 3 * error(chosen)


def test_choice_among_classifiers_that_learn_noise_is_less_optimistic():
    """The systems that vote on other folds were fitted to this one, which leaves a trace.

    It is largest where nothing can be learnt and samples vote for their neighbours; none would be
    left if every choice had systems of its own, fitted without the fold.
    """
    makers = [
        lambda _: KNeighborsClassifier(1), lambda _: KNeighborsClassifier(3),
        lambda _: GaussianNB(), lambda _: NearestCentroid(),
    ]  # fmt: skip
    chosen, procedure = accuracies_on_noise(makers, 50)
    assert chosen.mean() > 0.5 + 3 * error(chosen)
    assert (chosen - procedure).mean() > 3 * error(chosen - procedure)


POINTS = st.dictionaries(
    st.text(min_size=1), st.tuples(st.integers(1, 9), st.integers(0, 9)), min_size=1
)


@given(POINTS)
def test_pareto_line_is_what_nobody_beats(points):
    line = pareto(points)
    assert line
    for name, (cost, accuracy) in points.items():
        beaten = any(
            (c <= cost and a > accuracy) or (c < cost and a >= accuracy) for c, a in points.values()
        )
        assert (name in line) == (not beaten)


@pytest.mark.parametrize(
    ("cost", "accuracy", "expected"),
    [(5, None, "middle"), (None, 0.6, "middle"), (None, 0.5, "small"), (0.5, None, None)],
)
def test_budgets(cost, accuracy, expected):
    family = [
        candidate("small", 1, "++--"),
        candidate("middle", 4, "+++-"),
        candidate("large", 9, "++++"),
    ]
    found = within_budget(family, cost, accuracy)
    assert (found.name if found else None) == expected
