"""Which classes are confused: counts, recall, and pairs that another network tells apart."""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tex_lightning.evaluation.outcomes import Outcome

Counts = npt.NDArray[np.int64]


class Pair(NamedTuple):
    """A class and the one that it is taken for.

    The share is that of the fragments of the true class that are taken for the other, in (0, 1].
    """

    label: str
    predicted: str
    share: float
    samples: int


def vote_counts(outcomes: Sequence[Outcome], classes: Sequence[str]) -> Counts:
    """Count samples by true class (row) and predicted class (column), of ``classes`` alone."""
    return _count(classes, ((outcome.label, outcome.predicted, 1) for outcome in outcomes))


def fragment_counts(outcomes: Sequence[Outcome], classes: Sequence[str]) -> Counts:
    """Count fragments as :func:`vote_counts` does samples."""
    every = ((outcome.label, json.loads(outcome.votes)) for outcome in outcomes)
    return _count(
        classes, ((label, name, count) for label, votes in every for name, count in votes.items())
    )


def _count(classes: Sequence[str], votes: Iterable[tuple[str, str, int]]) -> Counts:
    index = {name: number for number, name in enumerate(classes)}
    counts = np.zeros((len(classes), len(classes)), dtype=np.int64)
    for label, name, count in votes:
        if label in index and name in index:
            counts[index[label], index[name]] += count
    return counts


def row_shares(counts: Counts) -> npt.NDArray[np.float64]:
    """Return counts as shares of their row; 0 in a row without any."""
    shares: npt.NDArray[np.float64] = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    return shares


def recall_by_class(counts: Counts) -> npt.NDArray[np.float64]:
    """Return the share of each row that is on the diagonal; NaN of a class that is not tested."""
    totals = counts.sum(axis=1)
    shares = np.full(len(counts), np.nan)
    np.divide(np.diag(counts), totals, out=shares, where=totals > 0)
    return shares


def confused_pairs(outcomes: Sequence[Outcome], classes: Sequence[str]) -> list[Pair]:
    """Return the pairs that a network confuses, by samples and then by fragments, the worst first.

    Of the two directions of a pair only the worse one is listed.
    """
    counts, samples = fragment_counts(outcomes, classes), vote_counts(outcomes, classes)
    shares = row_shares(counts)
    pairs = [
        Pair(classes[row], classes[column], float(shares[row, column]), int(samples[row, column]))
        for row, column in np.argwhere((counts > 0) | (samples > 0)).tolist()
        if row != column
    ]
    pairs.sort(key=lambda pair: (-pair.samples, -pair.share))
    listed: dict[frozenset[str], Pair] = {}
    for pair in pairs:
        listed.setdefault(frozenset(pair[:2]), pair)
    return list(listed.values())


class OwnPair(NamedTuple):
    """A pair that one network confuses, and what the others make of it.

    Of these it is the larger share of fragments of one of both that is taken for the other.
    """

    network: str
    pair: Pair
    others: dict[str, float]


def own_pairs(
    outcomes: Mapping[str, Sequence[Outcome]], classes: Sequence[str], most: int = 3
) -> list[OwnPair]:
    """Return the pairs that each network confuses much more than another one does.

    Args:
        outcomes: Outcomes of the same recordings by network.
        classes: Names of the classes.
        most: So many pairs of each network.
    """
    shares = {name: row_shares(fragment_counts(each, classes)) for name, each in outcomes.items()}
    index = {name: number for number, name in enumerate(classes)}
    found = []
    for network, each in outcomes.items():
        own = []
        for pair in confused_pairs(each, classes):
            row, column = index[pair.label], index[pair.predicted]
            others = {
                name: float(max(table[row, column], table[column, row]))
                for name, table in shares.items()
                if name != network
            }
            if others and min(others.values()) < pair.share:
                own.append(OwnPair(network, pair, others))
        own.sort(key=lambda it: -(it.pair.share - min(it.others.values())))
        found += own[:most]
    return found
