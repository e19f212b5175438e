"""Accuracy by the conditions under which the test samples were recorded."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tex_lightning.data.folds import Sample, comparable
from tex_lightning.data.recordings import natural_key
from tex_lightning.evaluation.outcomes import Outcome, wilson_interval

KEY = "conditions"  # of a network's entry in results.json

Votes = tuple[str, str, int, int]  # name, value, correct, test samples


def by_condition(samples: Sequence[Sample], outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Part of a network's entry of ``results.json``; empty where nothing has conditions.

    A sample of several senses has the conditions of all its recordings.

    Args:
        samples: What was tested.
        outcomes: What became of each.

    Returns:
        Under ``conditions``, by name and by value: ``correct``, ``test_samples``,
        ``vote_accuracy`` and Wilson's ``vote_ci95``.
    """
    votes: list[Votes] = []
    for sample, outcome in zip(samples, outcomes, strict=True):
        rows = sample.recordings.values()
        given = dict.fromkeys(
            (name, comparable(value)) for row in rows for name, value in row.conditions
        )
        votes += [(*each, int(outcome.label == outcome.predicted), 1) for each in given]
    return _entry(votes)


def pool_conditions(entries: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Add up the counts of :func:`by_condition` over several folds."""
    return _entry(
        (name, value, counts["correct"], counts["test_samples"])
        for entry in entries
        for name, values in entry.get(KEY, {}).items()
        for value, counts in values.items()
    )


def _entry(votes: Iterable[Votes]) -> dict[str, Any]:
    totals: dict[str, dict[str, tuple[int, int]]] = {}
    for name, value, correct, count in votes:
        values = totals.setdefault(name, {})
        before = values.get(value, (0, 0))
        values[value] = before[0] + correct, before[1] + count
    found = {
        name: {value: counted(*values[value]) for value in sorted(values, key=natural_key)}
        for name, values in totals.items()
    }
    return {KEY: found} if found else {}


def counted(correct: int, count: int) -> dict[str, Any]:
    """Counts of votes as an entry of ``results.json`` has them."""
    return {
        "correct": correct,
        "test_samples": count,
        "vote_accuracy": correct / count,
        "vote_ci95": wilson_interval(correct, count),
    }
