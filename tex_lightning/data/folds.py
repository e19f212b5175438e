"""Folds by recording number or by conditions, and samples: what is classified as one.

A recording's fold is its group modulo the number of folds, so that everything recorded together
is tested together. The paper (section IV) trains on nine recordings of each class and tests on
the tenth, ten times.
"""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tex_lightning.config import Folding
from tex_lightning.data.conditions import is_tested, tested_part
from tex_lightning.data.recordings import Recording, Recordings, plural
from tex_lightning.errors import UserError, listed


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


def split(recordings: Recordings, by: Folding) -> Split:
    """Divide by fold, or by ``test_where`` where the recordings of a sense have its conditions.

    Where few recordings of a class are trained on, they are the next ones after the tested fold,
    so that ten folds are ten draws of them and any two systems see the same.
    """
    parts: dict[str, list[Recording]] = {"train": [], "val": [], "test": []}
    for row in recordings:
        parts[_part(row, by)].append(row)
    if by.per_class is not None:
        parts["train"] = next_of_each(parts["train"], by.per_class, by.test_fold or 0, by.folds)
    return Split(*(Recordings(tuple(parts[name])) for name in ("train", "val", "test")))


def _part(row: Recording, by: Folding) -> str:
    fold = row.group % by.folds
    alone, others = ("train", "test") if by.inverted else ("test", "train")
    tested = None if by.test_where is None else is_tested(row, by.test_where)
    if tested is None:  # nothing but its fold decides
        tested = by.test_fold is None or fold == by.test_fold
    return alone if tested else "val" if fold == by.val_fold else others


def next_of_each(rows: Sequence[Recording], count: int, fold: int, folds: int) -> list[Recording]:
    """The first ``count`` recordings of each class and sense after a fold, cyclically."""
    following = sorted(rows, key=lambda row: ((row.group - fold) % folds, row.group))
    taken: Counter[tuple[str, str]] = Counter()
    kept = set()
    for row in following:
        taken[row.label, row.modality] += 1
        if taken[row.label, row.modality] <= count:
            kept.add(row)
    return [row for row in rows if row in kept]


def make_samples(part: Recordings, modalities: Sequence[str]) -> list[Sample]:
    """List the samples of one part, class by class in file order.

    Of several modalities the longest list of a class decides the number of samples and shorter ones
    are gone through again, so that every recording is seen; a class that lacks one gives none.
    """
    found: dict[tuple[str, str], list[Recording]] = defaultdict(list)
    for row in part:
        found[row.label, row.modality].append(row)
    samples: list[Sample] = []
    for label in part.classes:
        rows = {modality: found[label, modality] for modality in modalities}
        if all(rows.values()):
            samples += [
                Sample(label, {name: each[i % len(each)] for name, each in rows.items()})
                for i in range(max(map(len, rows.values())))
            ]
    return samples


def check_split(parts: Split, classes: list[str], modalities: Sequence[str], by: Folding) -> None:
    """Make sure that every class can be trained and that there is something to test.

    Raises:
        UserError: Naming the classes and the modality that are missing.
    """
    for modality in modalities:
        absent = sorted(set(classes) - {row.label for row in parts.train.of(modality)})
        if absent:
            raise UserError(
                f"There are no {plural(modality)} to train on for {listed(absent)}; add "
                "recordings, leave the class out, "
                + ("test less in data.test_where, " if by.test_where else "")
                + "or choose a model that does without them."
            )
    if not make_samples(parts.test, modalities):
        tested = tested_part(by)
        raise UserError(
            f"{tested[:1].upper()}{tested[1:]} holds nothing to test on that has "
            f"{' and '.join(modalities)}; choose another "
            + ("data.test_where." if by.test_where else "data.test_fold or fewer data.folds.")
        )
