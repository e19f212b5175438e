"""Folds by recording number, and samples: what is classified as one.

A recording's fold is its group modulo the number of folds, so that everything recorded together
is tested together. The paper (section IV) trains on nine recordings of each class and tests on
the tenth, ten times.
"""

from dataclasses import dataclass
from typing import Literal

from tex_lightning.data.recordings import Modality, Recording, Recordings
from tex_lightning.errors import UserError, listed

Kind = Literal["haptic", "visual", "fusion"]
NEEDS: dict[Kind, tuple[Modality, ...]] = {
    "haptic": ("haptic",),
    "visual": ("image",),
    "fusion": ("haptic", "image"),
}


@dataclass(frozen=True)
class Split:
    """Recordings for training, validation (may be empty) and test."""

    train: Recordings
    val: Recordings
    test: Recordings


@dataclass(frozen=True)
class Sample:
    """A trace, a photo, or one of each of the same class."""

    label: str
    haptic: Recording | None
    image: Recording | None


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


def make_samples(part: Recordings, kind: Kind) -> list[Sample]:
    """List the samples of one part, class by class in file order.

    For fusion the longer list of a class decides the number of pairs and the shorter one is gone
    through again, so that every recording is seen; a class that lacks a modality gives none.
    """
    samples: list[Sample] = []
    for label in part.classes:
        rows = part.in_classes([label])
        traces, photos = rows.of("haptic").rows, rows.of("image").rows
        if kind == "haptic":
            samples += [Sample(label, trace, None) for trace in traces]
        elif kind == "visual":
            samples += [Sample(label, None, photo) for photo in photos]
        elif traces and photos:
            samples += [
                Sample(label, traces[i % len(traces)], photos[i % len(photos)])
                for i in range(max(len(traces), len(photos)))
            ]
    return samples


def check_split(parts: Split, classes: list[str], kind: Kind, test_fold: int) -> None:
    """Make sure that every class can be trained and that there is something to test.

    Raises:
        UserError: Naming the classes and the modality that are missing.
    """
    for modality in NEEDS[kind]:
        absent = sorted(set(classes) - {row.label for row in parts.train.of(modality)})
        if absent:
            what = "traces" if modality == "haptic" else "photos"
            raise UserError(
                f"There are no {what} to train on for {listed(absent)}; add recordings, "
                "leave the class out, or choose a model that does without them."
            )
    if not make_samples(parts.test, kind):
        raise UserError(
            f"Fold {test_fold} holds nothing to test a {kind} network on; "
            "choose another data.test_fold or fewer data.folds."
        )
