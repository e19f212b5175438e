"""Classes put together to categories, where there are too many for a chart to name each."""

import re
from collections.abc import Sequence
from itertools import pairwise
from math import sqrt

import numpy as np
from scipy.cluster.hierarchy import leaves_list, linkage
from scipy.spatial.distance import pdist

from tex_lightning.data.recordings import natural_key
from tex_lightning.evaluation.fragments import Counts, Shares
from tex_lightning.report.labels import brief

LONGEST = 16  # characters of a class that names a category
MOST = 15  # categories that a chart has room for
LEAST_EACH = 3  # classes of a category, on average
WORD = re.compile(r"[A-Z]?\d+|[A-Z]?[a-z]+|[A-Z]+")


def categories(counts: Counts, classes: Sequence[str]) -> dict[str, list[int]]:
    """Divide classes into categories: by their names, or by what is confused.

    The first word at the same place of all names that tells at least two and at most 15 categories
    names them, as ``G1`` of LMT-108's ``G1RhombAluminumMesh`` and ``mesh`` of ``S001_mesh_soft``.
    Without one, classes that are taken for each other most are together, and each category is
    called by its most confused class.

    Args:
        counts: Counts of samples, true class by predicted class.
        classes: Their names.

    Returns:
        Indices of the classes by category, in the order in which they are drawn.
    """
    words = [WORD.findall(name) for name in classes]
    most = min(MOST, len(classes) // LEAST_EACH)
    for place in range(min(map(len, words))):
        values = [each[place] for each in words]
        if 1 < len(set(values)) <= most:
            return _grouped(values)
    return _clusters(counts, classes)


def _grouped(values: Sequence[str]) -> dict[str, list[int]]:
    names = sorted(set(values), key=natural_key)
    return {name: [index for index, own in enumerate(values) if own == name] for name in names}


def _clusters(counts: Counts, classes: Sequence[str]) -> dict[str, list[int]]:
    """About as many as each has classes, at most 15, so that what is confused is within them."""
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    distances = pdist(shares + shares.T)
    order = leaves_list(linkage(distances, "ward", optimal_ordering=True))
    errors = shares.sum(axis=1) - np.diag(shares)
    ends = _cuts(shares[np.ix_(order, order)], min(MOST, round(sqrt(len(classes)))))
    found: dict[str, list[int]] = {}
    for begin, end in pairwise([0, *ends]):
        members = order[begin:end].tolist()
        worst = max(members, key=lambda index: errors[index])
        name = f"{brief(classes[worst], LONGEST)} + {len(members) - 1}"
        if name in found:  # names that differ where they were shortened
            name += f" ({len(found) + 1})"
        found[name] = members
    return found


def _cuts(shares: Shares, count: int) -> list[int]:
    """Where to end so many stretches of the classes, for the most of the shares to be within them.

    None has fewer than two classes, or more than twice the mean.
    """
    size = len(shares)
    sums = np.pad(shares.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    best: dict[int, tuple[float, list[int]]] = {0: (0.0, [])}  # by the end of what is divided
    for _ in range(count):
        longer: dict[int, tuple[float, list[int]]] = {}
        for begin, (within, ends) in best.items():
            for end in range(begin + 2, min(begin + 2 * size // count, size) + 1):
                block = sums[end, end] - sums[begin, end] - sums[end, begin] + sums[begin, begin]
                longer[end] = max(longer.get(end, (-1.0, [])), (within + block, [*ends, end]))
        best = longer
    return best[size][1]
