"""Which classes are confused: counts, recall, and pairs that another network tells apart."""

import json
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tex_lightning.evaluation.outcomes import Counts, Outcome, vote_counts


class Pair(NamedTuple):
    """A class and the one that it is taken for.

    Attributes:
        label: The true class.
        predicted: The other one.
        share: Share of the fragments of the true class that are taken for the other, in (0, 1].
        samples: Number of samples that are.
    """

    label: str
    predicted: str
    share: float
    samples: int


def fragment_counts(outcomes: Sequence[Outcome], classes: Sequence[str]) -> Counts:
    """Count fragments by true class (row) and predicted class (column).

    A class that is not among them has neither.
    """
    index = {name: number for number, name in enumerate(classes)}
    counts = np.zeros((len(classes), len(classes)), dtype=np.int64)
    for outcome in outcomes:
        if outcome.label in index:
            for name, votes in json.loads(outcome.votes).items():
                if name in index:
                    counts[index[outcome.label], index[name]] += votes
    return counts


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
    counts = fragment_counts(outcomes, classes)
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    samples = vote_counts(outcomes, classes)
    index = {name: number for number, name in enumerate(classes)}
    pairs = [
        Pair(classes[row], classes[column], float(shares[row, column]), int(samples[row, column]))
        for row, column in np.argwhere((counts > 0) | (samples > 0)).tolist()
        if row != column
    ]
    pairs.sort(key=lambda pair: (-pair.samples, -pair.share, index[pair.label]))
    listed: dict[frozenset[str], Pair] = {}
    for pair in pairs:
        listed.setdefault(frozenset(pair[:2]), pair)
    return list(listed.values())


def _share(counts: Counts, row: int, column: int) -> float:
    """Return the share of the fragments of one class that are taken for another."""
    return float(counts[row, column] / max(1, counts[row].sum()))


class OwnPair(NamedTuple):
    """A pair that one network confuses, and what the others make of it.

    Attributes:
        network: Name of the network.
        pair: What it confuses.
        others: By network the larger share of fragments of one of both that it takes for the other.
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
    counts = {name: fragment_counts(each, classes) for name, each in outcomes.items()}
    index = {name: number for number, name in enumerate(classes)}
    found = []
    for network, each in outcomes.items():
        own = []
        for pair in confused_pairs(each, classes):
            row, column = index[pair.label], index[pair.predicted]
            others = {
                name: max(_share(table, row, column), _share(table, column, row))
                for name, table in counts.items()
                if name != network
            }
            if others and min(others.values()) < pair.share:
                own.append(OwnPair(network, pair, others))
        own.sort(key=lambda it: -(it.pair.share - min(it.others.values())))
        found += own[:most]
    return found
