"""Divide recordings into training, validation and test, and pair them to samples.

All recordings of a group are in the same fold. Groups are spread over the folds so that each fold
has about as many recordings of every class and modality. With ten recordings of each class, nine
are trained on and the tenth is tested, ten times, as in the paper (section IV). A table may fix the
folds of its recordings. With ``data.test_where``, the recordings with these conditions are tested.
"""

import json
import re
import shlex
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tex_lightning.config import Folding
from tex_lightning.core.groups import divide
from tex_lightning.data.recordings import Recording, Recordings, normal_form, plural
from tex_lightning.errors import UserError, listed, nearest
from tex_lightning_runtime.files import natural_key

DECIMAL = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)")


def comparable(value: object) -> str:
    """Return the same text for equal values, such as ``60``, ``"60"`` and ``60.0``.

    YAML's ``true`` equals Python's ``True``. All else is compared as text, even ``007``, ``1_0``
    and ``1e3``, which may be names.
    """
    text = normal_form(str(value))
    if not DECIMAL.fullmatch(text):
        return text.lower() if text in ("True", "False") else text
    return str(float(text)).removesuffix(".0")


def is_tested(row: Recording, where: Mapping[str, Any]) -> bool | None:
    """Return whether a recording has the tested conditions; None without any of their columns."""
    conditions = {name: value for name, value in row.conditions if name in where}
    if not conditions:
        return None
    return all(
        comparable(value) in map(comparable, _values(where[name]))
        for name, value in conditions.items()
    )


def check_conditions(recordings: Recordings, where: Mapping[str, Any]) -> None:
    """Make sure that the recordings can be divided by ``data.test_where``.

    Raises:
        UserError: If no recording has such a condition or value, or only some of a sense have it.
    """
    for name, wanted in where.items():
        values = [(row, dict(row.conditions).get(name)) for row in recordings]
        known = {comparable(value) for _, value in values if value is not None}
        for value in _values(wanted):
            if comparable(value) not in known:
                raise _no_such_condition(recordings, name, value, sorted(known, key=natural_key))
        having = {row.modality for row, value in values if value is not None}
        absent = [row for row, value in values if value is None and row.modality in having]
        if absent:
            raise UserError(
                f"data.test_where names {name}, which {len(absent)} of the {len(values)} "
                f"recordings do not say, {absent[0].path} for one: fill it in, or leave them out."
            )


def _no_such_condition(
    recordings: Recordings, name: str, value: object, known: Sequence[str]
) -> UserError:
    """Return the error for a value of a condition that is not among the ``known`` ones."""
    names = dict.fromkeys(key for row in recordings for key, _ in row.conditions)
    near = nearest(str(value), known) if known else nearest(name, names)
    return UserError(
        f"data.test_where: no recording has {name} {value}{near}; choose from "
        f"{listed(known or list(names)) or 'columns of a manifest (data=manifest)'}."
    )


def tested_part(by: Folding) -> str:
    """Describe the tested part: conditions, such as ``speed 50 or 60``, a fold, or all data."""
    if by.test_where is not None:
        return "the part with " + " and ".join(
            f"{name} {' or '.join(map(str, _values(wanted)))}"
            for name, wanted in by.test_where.items()
        )
    return "all of the data" if by.test_fold is None else f"fold {by.test_fold}"


def as_override(where: Mapping[str, Any] | None) -> str:
    """Return the override ``data.test_where=...`` for conditions, quoted for a shell."""
    if where is None:
        return "data.test_where=null"
    pairs = (f"{name}: {json.dumps(wanted, ensure_ascii=False)}" for name, wanted in where.items())
    return shlex.quote(f"data.test_where={{{', '.join(pairs)}}}")


def _values(wanted: object) -> Iterable[object]:
    return wanted if isinstance(wanted, list) else [wanted]


@dataclass(frozen=True)
class Split:
    """Recordings for training, validation (may be empty) and test."""

    train: Recordings
    val: Recordings
    test: Recordings


@dataclass(frozen=True)
class Sample:
    """A recording of each sense, all of the same class.

    Attributes:
        label: Class name.
        recordings: By modality.
    """

    label: str
    recordings: Mapping[str, Recording]


def with_folds(recordings: Recordings, folds: int) -> Recordings:
    """Assign a fold to every recording of a table, unless all have one.

    Groups are assigned in natural order. If all classes have equally many recordings, the n-th
    recording of each is in fold n, modulo the number of folds.

    Args:
        recordings: The whole table; for a part of it the folds could differ.
        folds: Number of folds. It is reduced to the number of groups of the class with most groups.
    """
    rows = recordings.rows
    if all(row.fold is not None for row in rows):
        return recordings
    kinds, groups = [(row.label, row.modality) for row in rows], [row.group_key for row in rows]
    of_kind = Counter(kind for kind, _ in {*zip(kinds, groups, strict=True)})
    most = max(*of_kind.values(), min(2, len({*groups})))  # two groups are two folds, if of a class
    order = {group: at for at, group in enumerate(sorted({*groups}, key=natural_key))}
    width = len(str(len(order)))
    names = [f"{order[group]:0{width}}" for group in groups]  # in whose order equals are taken
    numbers = divide(kinds, names, min(folds, most))
    folded = zip(rows, numbers, strict=True)
    return replace(recordings, rows=tuple(replace(row, fold=fold) for row, fold in folded))


def count_folds(recordings: Recordings) -> int:
    """Return the number of folds of a table with folds, but at least 2."""
    return max(2, 1 + max(row.fold or 0 for row in recordings))


def absent_classes(
    part: Recordings, classes: Sequence[str], modalities: Sequence[str]
) -> list[str]:
    """Return the classes of which a part has no sample of all modalities together."""
    there = [{row.label for row in part.of(modality)} for modality in modalities]
    return [label for label in classes if not all(label in labels for labels in there)]


def split(recordings: Recordings, by: Folding, *, trains: bool = False) -> Split:
    """Divide by fold, or by ``test_where`` where the recordings of a modality have its conditions.

    With ``per_class``, the recordings trained on are the next ones after the tested fold. So ten
    folds are ten draws of them, and any two systems are trained on the same.

    Args:
        recordings: The recordings.
        by: The division.
        trains: What a division without a test fold means: with True all recordings are trained on,
            with False all are tested.
    """
    parts: dict[str, list[Recording]] = {"train": [], "val": [], "test": []}
    for row in with_folds(recordings, by.folds):
        parts[_part(row, by, trains=trains)].append(row)
    if by.per_class is not None:
        parts["train"] = next_of_each(parts["train"], by.per_class, by.test_fold or 0, by.folds)
    return Split(*(Recordings(tuple(parts[name])) for name in ("train", "val", "test")))


def _part(row: Recording, by: Folding, *, trains: bool) -> str:
    inverted = by.inverted and by.test_fold is not None
    alone, others = ("train", "test") if inverted else ("test", "train")
    tested = None if by.test_where is None else is_tested(row, by.test_where)
    if tested is None:  # nothing but its fold decides
        tested = not trains if by.test_fold is None else row.fold == by.test_fold
    return alone if tested else "val" if row.fold == by.val_fold else others


def next_of_each(rows: Sequence[Recording], count: int, fold: int, folds: int) -> list[Recording]:
    """Return the first ``count`` recordings of each class and sense after a fold, cyclically."""

    def place(row: Recording) -> tuple[int, Any]:
        assert row.fold is not None, "the reader's table has folds"
        return (row.fold - fold) % folds, natural_key(str(row.group))

    counts: Counter[tuple[str, str]] = Counter()
    kept = set()
    for row in sorted(rows, key=place):
        counts[row.label, row.modality] += 1
        if counts[row.label, row.modality] <= count:
            kept.add(row)
    return [row for row in rows if row in kept]


def make_samples(part: Recordings, modalities: Sequence[str]) -> list[Sample]:
    """List the samples of one part, class by class in file order.

    With several modalities, a class has as many samples as recordings of the modality with most of
    them; those of the others are repeated. A class without recordings of one modality has none.
    """
    lists: dict[tuple[str, str], list[Recording]] = defaultdict(list)
    for row in part:
        lists[row.label, row.modality].append(row)
    samples: list[Sample] = []
    for label in part.classes:
        rows = {modality: lists[label, modality] for modality in modalities}
        if all(rows.values()):
            samples += [
                Sample(label, {name: members[i % len(members)] for name, members in rows.items()})
                for i in range(max(map(len, rows.values())))
            ]
    return samples


def check_split(parts: Split, classes: list[str], modalities: Sequence[str], by: Folding) -> None:
    """Check that every class has recordings to train on, and that the tested part has samples.

    Raises:
        UserError: Naming the classes and the modality that are missing.
    """
    for modality in modalities:
        absent = sorted(set(classes) - {row.label for row in parts.train.of(modality)})
        if absent:
            validate = {row.label for row in parts.val.of(modality)} & {*absent}
            free = " give data.val_fold=null, which validates on none of them," if validate else ""
            others = (*parts.val.of(modality), *parts.test.of(modality))
            groups = {row.group_key for row in others if row.label in absent}
            alone = f", which are all of the group {groups.pop()}" if len(groups) == 1 else ""
            raise UserError(
                f"There are no {plural(modality)} to train on for {listed(absent)}{alone};{free} "
                "add recordings, test less, leave the class out, or choose a model without them."
            )
    if by.withholds and not make_samples(parts.test, modalities):
        tested = tested_part(by)
        raise UserError(
            f"{tested[:1].upper()}{tested[1:]} holds nothing to test on that has "
            f"{' and '.join(modalities)}; choose another data.test_fold or data.test_where."
        )
