"""Readers of the databases of TU Munich: LMT-69, the TUM haptic texture database, and LMT-108.

LMT-69: traces are ``Training/Accel/{label}_query{0..9}.txt``: 10 kHz, already reduced to one axis
by DFT321, one number a line. Photos are ``IMG_*.JPG`` whose names carry no class; their order does:
ten per class, in the order of the class names. Public sources do not name the photo folder, so the
one folder below ``Training`` that holds such photos is taken (``ImageMagnified`` aside). Where that
order does not hold, ``data.manifest`` names the photos' classes instead.

LMT-108: accelerations are
``AccelScansComponents/Movement/.../{label}_Movement_{X,Y,Z}_train{n}.txt``: 10 kHz, one axis a
file, which decoding puts together. Photos are
``ImageScans/NoFlash/.../{label}_Image_{i}_train{n}.jpg``, sounds of the same strokes
``SoundScans/Movement/.../{label}_Sound_Movement_train{n}.wav``, 44.1 kHz. Ten recordings per class
are for training and ten for testing (``test`` instead of ``train``); ``split`` says which of the
two are read. The number of a recording decides its fold.

LMT-108 has more folders, such as ``AccelScansComponents/Tapping`` and ``FricScans/FSR1``. Any can
be a sense of the user's own, whose files are ``{label}_{words}_train{n}`` with or without an axis.
Their exact names were read nowhere, nor the rates of those that are no accelerations: they are what
``data.file_rate`` says.
"""

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tex_lightning.config.keys import choice
from tex_lightning.data.decode import IMAGE_SUFFIXES
from tex_lightning.data.readers import check_same_classes
from tex_lightning.data.recordings import (
    Recording,
    Recordings,
    natural_key,
    number_files,
    read_manifest,
)
from tex_lightning.data.traces import TRACE_SUFFIXES, axis_files
from tex_lightning.errors import UserError

PER_CLASS = 10
RATE = 10_000.0


@dataclass
class TumReader:
    """The TUM haptic texture database.

    Attributes:
        root: Folder of the database.
        manifest: File that names the photos' classes; None where their order does.
    """

    root: str
    manifest: str | None

    def read(self) -> Recordings:
        """Read the training part of the database."""
        return read_tum(Path(self.root).expanduser(), self.manifest)


def read_tum(root: Path, manifest: str | None = None) -> Recordings:
    """Read the training part of the database.

    Raises:
        UserError: If there are no traces, or photos whose classes cannot be told by their order.
    """
    training = root / "Training"
    files: dict[str, list[Path]] = defaultdict(list)
    for path in (training / "Accel").glob("*.txt"):
        if match := re.fullmatch(r"(.+)_query\d+", path.stem):
            files[match[1]].append(path)
    if not files:
        raise UserError(
            f"Folder {training / 'Accel'} holds no LABEL_query0.txt files; check data.root."
        )
    rows = [row for label in files for row in number_files(label, "haptic", files[label], RATE)]
    if manifest is not None:
        rows += read_manifest(Path(manifest).expanduser()).of("image")
    else:
        rows += _read_photos(training, sorted(files, key=natural_key))
    return Recordings(tuple(rows))


def _read_photos(training: Path, labels: list[str]) -> list[Recording]:
    """Photos by sorted order; none at all is allowed, since HapticNet needs none."""
    found = [
        photos
        for folder in sorted(training.iterdir())
        if folder.is_dir() and folder.name != "ImageMagnified" and (photos := _photos_in(folder))
    ]
    if found and (len(found) > 1 or len(found[0]) != PER_CLASS * len(labels)):
        told = " and ".join(f"{len(photos)} in {photos[0].parent.name}" for photos in found)
        raise UserError(
            f"Folder {training} holds the photos {told}, but {len(labels)} classes need "
            f"{PER_CLASS * len(labels)} in one folder; correct that, or name their classes in "
            "data.manifest."
        )
    return [
        Recording(labels[place // PER_CLASS], "image", path, place % PER_CLASS)
        for photos in found
        for place, path in enumerate(photos)
    ]


def _photos_in(folder: Path) -> list[Path]:
    photos = [path for path in folder.iterdir() if path.suffix.lower() in (".jpg", ".jpeg")]
    return sorted(photos, key=lambda path: natural_key(path.name))


ACCELERATIONS = "AccelScansComponents"
SOUND_RATE = 44_100.0
MARKS = {"training": "train", "testing": "test"}
# what stands between label and mark, with the suffix; and an example
NAMES = {
    "haptic": (r"(.+)_Movement_[XYZ]_{}(\d+)\.txt", "LABEL_Movement_X_{}1.txt"),
    "image": (r"(.+)_Image_\d+_{}(\d+)\.jpg", "LABEL_Image_1_{}1.jpg"),
    "sound": (r"(.+)_Sound_Movement_{}(\d+)\.wav", "LABEL_Sound_Movement_{}1.wav"),
}
OWN = (r"([^_]+(?:_\d+)?)_.*?{}(\d+)\.[^.]+", "LABEL_Tapping_X_{}1.txt")


@dataclass
class Lmt108Reader:
    """LMT-108.

    Attributes:
        root: Folder of the database.
        split: Half that is read, ``training`` or ``testing``.
        folders: Folder of each sense, below ``root``; None leaves it out. That of photos or sounds
            may be missing.

    Raises:
        UserError: If there is no such half.
    """

    root: str
    split: str
    folders: Mapping[str, str | None]

    def __post_init__(self) -> None:
        for complaint in choice("data.reader.split", self.split, tuple(MARKS)):
            raise UserError(f"{complaint}.")

    def read(self) -> Recordings:
        """Read all senses of one half; without photos or sounds, the others alone.

        Raises:
            UserError: If traces are missing, an axis is, or the senses do not have the same
                classes.
        """
        root = Path(self.root).expanduser()
        rows = [
            row
            for modality, folder in self.folders.items()
            if folder is not None
            for row in _read_sense(root / folder, modality, MARKS[self.split])
        ]
        check_same_classes(root, rows)
        return Recordings(tuple(rows))


def _read_sense(folder: Path, modality: str, mark: str) -> list[Recording]:
    """Read one recording for each number."""
    pattern, example = NAMES.get(modality, OWN)
    found = _numbered(folder, pattern.format(mark))
    if not found and modality not in ("image", "sound"):
        raise UserError(
            f"Folder {folder} holds no {example.format(mark)} files; data.root must hold that "
            f"folder (data.reader.folders.{modality})."
        )
    rate = SOUND_RATE if modality == "sound" else RATE if ACCELERATIONS in folder.parts else None
    rows = []
    for (label, number), files in sorted(found.items()):
        whole = axis_files(files[0])
        if tuple(files) != whole or (modality == "haptic" and len(whole) != 3):
            raise UserError(
                f"Recording {number} of {label} in {folder} is {', '.join(x.name for x in files)}; "
                "a recording is one file, or one for each axis X, Y and Z: copy it again."
            )
        rows.append(Recording(label, modality, files[0], number - 1, rate))
    return rows


def _numbered(folder: Path, pattern: str) -> dict[tuple[str, int], list[Path]]:
    """Files below a folder by label and number of the recording, in the order of names."""
    found: dict[tuple[str, int], list[Path]] = defaultdict(list)
    for path in sorted(folder.rglob("*")):
        match = re.fullmatch(pattern, path.name, re.IGNORECASE)
        if match and path.suffix.lower() in (*TRACE_SUFFIXES, *IMAGE_SUFFIXES):
            found[match[1], int(match[2])].append(path)
    return found
