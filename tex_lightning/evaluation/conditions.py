"""Accuracy by the conditions under which the test samples were recorded."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tex_lightning.data.folds import Sample, in_order, shown
from tex_lightning.evaluation.outcomes import Outcome, wilson_interval

KEY = "conditions"  # of a network's entry in results.json

Votes = tuple[str, str, int, int]  # name, value, correct, test samples


def by_condition(samples: Sequence[Sample], outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Part of a network's entry of ``results.json``; empty where nothing has conditions.

    A sample of several senses has the conditions of all its recordings. Rates of files are among
    them where they differ, as ``haptic rate`` in Hz to three digits.

    Args:
        samples: What was tested.
        outcomes: What became of each.

    Returns:
        Under ``conditions``, by name and by value: ``correct``, ``test_samples``,
        ``vote_accuracy`` and Wilson's ``vote_ci95``.
    """
    votes: list[Votes] = []
    for sample, outcome in zip(samples, outcomes, strict=True):
        given = {
            (name, shown(value)): None  # in their order
            for row in sample.recordings.values()
            for name, value in row.conditions
        }
        correct = int(outcome.label == outcome.predicted)
        votes += [(*each, correct, 1) for each in given]
    return _entry([*votes, *_by_rate(outcomes)])


def pool_conditions(
    entries: Iterable[Mapping[str, Any]], outcomes: Sequence[Outcome] = ()
) -> dict[str, Any]:
    """Pool several entries of :func:`by_condition`: their counts are added.

    Args:
        entries: Entries of one network's folds, or of several networks.
        outcomes: Those of all folds, which may have several rates where each fold has one.
    """
    rates = _by_rate(outcomes)
    counted = {name for name, *_ in rates}
    votes = [
        (name, value, counts["correct"], counts["test_samples"])
        for entry in entries
        for name, values in entry.get(KEY, {}).items()
        if name not in counted
        for value, counts in values.items()
    ]
    return _entry([*votes, *rates])


def _by_rate(outcomes: Sequence[Outcome]) -> list[Votes]:
    """Votes by the rate of each signal, where files differ in it."""
    votes: list[Votes] = []
    for modality in outcomes[0].file_rates if outcomes else ():
        rates = [f"{float(f'{each.file_rates[modality]:.3g}'):g}" for each in outcomes]
        correct = [int(each.label == each.predicted) for each in outcomes]
        if len(set(rates)) > 1:
            name = f"{modality} rate"
            votes += [(name, rate, won, 1) for rate, won in zip(rates, correct, strict=True)]
    return votes


def _entry(votes: Iterable[Votes]) -> dict[str, Any]:
    totals: dict[str, dict[str, tuple[int, int]]] = {}
    for name, value, correct, count in votes:
        values = totals.setdefault(name, {})
        before = values.get(value, (0, 0))
        values[value] = before[0] + correct, before[1] + count
    found = {
        name: {value: counted(*values[value]) for value in sorted(values, key=in_order)}
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
