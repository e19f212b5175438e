"""Accuracy by condition, such as speed, light or device."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from tex_lightning.data.folds import Sample, comparable
from tex_lightning.data.recordings import Recording
from tex_lightning.evaluation.outcomes import Outcome, counted
from tex_lightning_runtime.files import natural_key

CONDITIONS = "conditions"  # of a network's entry in results.json
MANY, FEW = 10, 4  # values of a condition; recordings of each
BINS, STEPS = 5, 1000  # of a continuous condition; of its range, to which edges are rounded
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")

Bins = Mapping[str, Sequence[float]]  # edges by the name of a condition
Votes = tuple[str, str, int, int]  # name, value, correct, test samples


def condition_bins(recordings: Iterable[Recording]) -> dict[str, list[float]]:
    """Return the edges of bins of conditions with nearly as many values as recordings.

    A column of forces or of times of day would fill a table with one line for every recording.

    Args:
        recordings: All recordings of a table, so that every part of it has the same bins.

    Returns:
        By the name of such a condition its quantiles; none where its values are no numbers or do
        not differ, which is left out.
    """
    values: dict[str, list[str]] = {}
    for row in recordings:
        for name, value in row.conditions:
            values.setdefault(name, []).append(comparable(value))
    return {
        name: _edges(found)
        for name, found in values.items()
        if len({*found}) > MANY and len(found) < FEW * len({*found})
    }


def _edges(values: Sequence[str]) -> list[float]:
    numbers = [float(value) for value in values if NUMBER.fullmatch(value)]
    spread = max(numbers) - min(numbers) if len(numbers) == len(values) else 0.0
    if not 0 < spread < math.inf:
        return []
    digits = math.ceil(math.log10(STEPS / spread))
    quantiles = np.quantile(numbers, np.linspace(0, 1, BINS + 1))
    return sorted({round(float(edge), digits) for edge in quantiles})


def by_condition(
    samples: Sequence[Sample], outcomes: Sequence[Outcome], bins: Bins
) -> dict[str, Any]:
    """Return part of a network's entry of ``results.json``; empty where nothing has conditions.

    A sample of several senses has the conditions of all its recordings; ``bins`` are those of
    :func:`condition_bins`.

    Returns:
        Under ``conditions``, by name and by value, or by bin as in ``40 to 60``: ``correct``,
        ``test_samples``, ``vote_accuracy`` and Wilson's ``vote_ci95``.
    """
    votes: list[Votes] = []
    for sample, outcome in zip(samples, outcomes, strict=True):
        rows = sample.recordings.values()
        conditions = dict.fromkeys(
            (name, _key(comparable(value), bins.get(name)))
            for row in rows
            for name, value in row.conditions
        )
        correct = int(outcome.correct)
        votes += [(name, key, correct, 1) for name, key in conditions if key is not None]
    return _entry(votes)


def _key(value: str, edges: Sequence[float] | None) -> str | None:
    """Return the bin of a value, or the value itself where there are no bins of it."""
    if edges is None:
        return value
    if not edges:
        return None
    place = int(np.searchsorted(edges[1:-1], float(value), side="right"))
    return f"{edges[place]:.12g} to {edges[place + 1]:.12g}"


def pool_conditions(entries: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Add up the counts of :func:`by_condition` over several folds."""
    return _entry(
        (name, value, counts["correct"], counts["test_samples"])
        for entry in entries
        for name, values in entry.get(CONDITIONS, {}).items()
        for value, counts in values.items()
    )


def _entry(votes: Iterable[Votes]) -> dict[str, Any]:
    totals: dict[str, dict[str, tuple[int, int]]] = {}
    for name, value, correct, count in votes:
        values = totals.setdefault(name, {})
        before = values.get(value, (0, 0))
        values[value] = before[0] + correct, before[1] + count
    counts = {
        name: {value: counted(*values[value]) for value in sorted(values, key=by_size)}
        for name, values in totals.items()
    }
    return {CONDITIONS: counts} if counts else {}


def by_size(key: str) -> tuple[bool, float, Any]:
    """Return what sorts values of a condition: numbers and bins by size, then words."""
    number = NUMBER.match(key)
    return number is None, float(number[0]) if number else 0.0, natural_key(key)
