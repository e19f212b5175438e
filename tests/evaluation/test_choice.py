from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.dummy import DummyClassifier
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid

from tex_lightning.evaluation.comparison import (
    MIN_SAMPLES,
    Candidate,
    one_standard_error,
    pareto,
    partner,
)


def candidate(name: str, cost: float, votes: str) -> Candidate:
    """Votes on numbered samples, + where they are correct."""
    return Candidate(name, cost, {(0, str(i)): mark == "+" for i, mark in enumerate(votes)})


@pytest.mark.parametrize("n", [1, 4, MIN_SAMPLES - 1, MIN_SAMPLES, 500])
def test_one_error_more_is_enough_only_where_there_are_many_samples(n):
    """One discordant sample of n: the mean difference is 1/n and so is its standard error."""
    best, small = candidate("best", 10, "+" * n), candidate("small", 1, "+" * (n - 1) + "-")
    expected = "small" if n >= MIN_SAMPLES else "best"
    assert one_standard_error([best, small]).name == expected


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


@pytest.mark.parametrize("folds", [3, 4, 5, 10, 11])
def test_every_fold_has_another_one_for_a_partner(folds):
    partners = {fold: partner(fold, folds) for fold in range(folds)}
    assert sorted(partners.values()) == list(range(folds))
    assert all(fold != other for fold, other in partners.items())
    if folds % 2 == 0:
        assert all(partners[other] == fold for fold, other in partners.items())


FOLDS, LABELS = np.repeat(np.arange(6), 8), np.tile([0, 1], 24)  # either class in every fold


def votes_on_noise(make, features) -> list[dict[tuple[int, str], bool]]:
    """For each fold the correct votes on it and on its partner, trained without both.

    Labels mean nothing.
    """
    votes = []
    for fold in range(6):
        own = np.isin(FOLDS, (fold, partner(fold, 6)))
        correct = make().fit(features[~own], LABELS[~own]).predict(features[own]) == LABELS[own]
        keys = [(int(FOLDS[n]), str(n)) for n in np.flatnonzero(own)]
        votes.append(dict(zip(keys, correct, strict=True)))
    return votes


def on(fold: int, votes: dict[tuple[int, str], bool]) -> dict[tuple[int, str], bool]:
    return {key: correct for key, correct in votes.items() if key[0] == fold}


def accuracies_on_noise(makers, repetitions: int) -> tuple[np.ndarray, np.ndarray]:
    """Accuracy of the system chosen on all votes, and of choosing each fold's on its partner."""
    chosen, procedure = [], []
    for seed in range(repetitions):
        rng = np.random.default_rng(seed)
        features = [rng.standard_normal((48, 3)) for _ in makers]  # of its own for each system
        votes = [votes_on_noise(partial(make, rng), features[n]) for n, make in enumerate(makers)]
        everything = [
            Candidate(str(n), n, dict(pair for f in range(6) for pair in on(f, own[f]).items()))
            for n, own in enumerate(votes)
        ]
        chosen.append(one_standard_error(everything).accuracy)
        used = []
        for fold in range(6):
            family = [
                Candidate(str(n), n, on(partner(fold, 6), own[fold])) for n, own in enumerate(votes)
            ]
            used += on(fold, votes[int(one_standard_error(family).name)][fold]).values()
        procedure.append(np.mean(used))
    return np.array(chosen), np.array(procedure)


def error(values: np.ndarray) -> float:
    return values.std(ddof=1) / np.sqrt(len(values))


def guesser(rng) -> DummyClassifier:
    return DummyClassifier(strategy="uniform", random_state=int(rng.integers(10_000)))


LEARNERS = [
    lambda _: KNeighborsClassifier(1), lambda _: KNeighborsClassifier(3),
    lambda _: GaussianNB(), lambda _: NearestCentroid(),
]  # fmt: skip


@pytest.mark.parametrize("makers", [[guesser] * 6, LEARNERS])
def test_nothing_is_gained_by_choosing_where_there_is_nothing_to_learn(makers):
    """The system chosen on all votes seems better on them; the choice itself does not."""
    chosen, procedure = accuracies_on_noise(makers, 60)
    assert chosen.mean() > 0.5 + 3 * error(chosen)
    assert abs(procedure.mean() - 0.5) < 3 * error(procedure)


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
