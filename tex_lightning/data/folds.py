"""Folds by recording number, and samples: what is classified as one.

A recording's fold is its group modulo the number of folds, so that everything recorded together
is tested together. The paper (section IV) trains on nine recordings of each class and tests on
the tenth, ten times.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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


def split(
    recordings: Recordings,
    folds: int,
    test_fold: int | None,
    val_fold: int | None,
    inverted: bool = False,
) -> Split:
    """Divide by fold.

    Args:
        recordings: What is divided.
        folds: Number of folds.
        test_fold: The fold that is tested; with None everything is test.
        val_fold: The fold that is validation and neither trained nor tested; None for none.
        inverted: ``test_fold`` alone is trained on and the others are tested.
    """
    if test_fold is None:
        return Split(Recordings(()), Recordings(()), recordings)
    parts: dict[str, list[Recording]] = {"train": [], "val": [], "test": []}
    for row in recordings:
        fold = row.group % folds
        alone, others = ("train", "test") if inverted else ("test", "train")
        parts[alone if fold == test_fold else "val" if fold == val_fold else others].append(row)
    return Split(*(Recordings(tuple(parts[name])) for name in ("train", "val", "test")))


def make_samples(part: Recordings, modalities: Sequence[str]) -> list[Sample]:
    """List the samples of one part, class by class in file order.

    Of several modalities the longest list of a class decides the number of samples and shorter ones
    are gone through again, so that every recording is seen; a class that lacks one gives none.
    """
    samples: list[Sample] = []
    for label in part.classes:
        found = part.in_classes([label])
        rows = {modality: found.of(modality).rows for modality in modalities}
        if all(rows.values()):
            samples += [
                Sample(label, {name: each[i % len(each)] for name, each in rows.items()})
                for i in range(max(map(len, rows.values())))
            ]
    return samples


def check_split(
    parts: Split, classes: list[str], modalities: Sequence[str], test_fold: int
) -> None:
    """Make sure that every class can be trained and that there is something to test.

    Raises:
        UserError: Naming the classes and the modality that are missing.
    """
    for modality in modalities:
        absent = sorted(set(classes) - {row.label for row in parts.train.of(modality)})
        if absent:
            raise UserError(
                f"There are no {plural(modality)} to train on for {listed(absent)}; add "
                "recordings, leave the class out, or choose a model that does without them."
            )
    if not make_samples(parts.test, modalities):
        raise UserError(
            f"Fold {test_fold} holds nothing to test on that has {' and '.join(modalities)}; "
            "choose another data.test_fold or fewer data.folds."
        )
