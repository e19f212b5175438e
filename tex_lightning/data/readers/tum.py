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
from tex_lightning.data.readers.classes import check_same_classes
from tex_lightning.data.recordings import (
    MODALITIES,
    Recording,
    Recordings,
    natural_key,
    number_files,
    plural,
    read_manifest,
)
from tex_lightning.data.trace_files import TRACE_SUFFIXES, axis_files
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
        UserError: If folders are missing, or counts do not fit ten per class.
    """
    training = root / "Training"
    if not training.is_dir():
        raise UserError(f"Folder {training} does not exist; data.root must hold Training/Accel.")
    traces = _read_traces(training / "Accel")
    labels = sorted({row.label for row in traces}, key=natural_key)
    if manifest is not None:
        photos = list(read_manifest(Path(manifest).expanduser()).of("image"))
        _check_labels(photos, labels, manifest)
    else:
        photos = _read_photos(training, labels)
    return Recordings((*traces, *photos))


def _read_traces(folder: Path) -> list[Recording]:
    files: dict[str, list[Path]] = defaultdict(list)
    for path in folder.glob("*.txt"):
        match = re.fullmatch(r"(.+)_query\d+", path.stem)
        if match:
            files[match[1]].append(path)
    if not files:
        raise UserError(f"Folder {folder} holds no LABEL_query0.txt files; check data.root.")
    wrong = {label: len(paths) for label, paths in files.items() if len(paths) != PER_CLASS}
    if wrong:
        listed = ", ".join(f"{label} has {count}" for label, count in sorted(wrong.items()))
        raise UserError(f"Folder {folder} must hold {PER_CLASS} traces per class, but {listed}.")
    return [row for label in files for row in number_files(label, "haptic", files[label], RATE)]


def _read_photos(training: Path, labels: list[str]) -> list[Recording]:
    """Photos by sorted order; none at all is allowed, since HapticNet needs none."""
    folders = [
        folder
        for folder in sorted(training.iterdir())
        if folder.is_dir() and folder.name != "ImageMagnified" and _photos_in(folder)
    ]
    if not folders:
        return []
    if len(folders) > 1:
        names = ", ".join(folder.name for folder in folders)
        raise UserError(
            f"Photos lie in several folders of {training} ({names}); "
            "leave one or name the photos' classes in data.manifest."
        )
    photos = _photos_in(folders[0])
    if len(photos) != PER_CLASS * len(labels):
        raise UserError(
            f"Folder {folders[0]} holds {len(photos)} photos, but {len(labels)} classes need "
            f"{PER_CLASS * len(labels)}; complete it or name their classes in data.manifest."
        )
    return [
        row
        for index, label in enumerate(labels)
        for row in number_files(label, "image", photos[index * PER_CLASS : (index + 1) * PER_CLASS])
    ]


def _photos_in(folder: Path) -> list[Path]:
    photos = [path for path in folder.iterdir() if path.suffix.lower() in (".jpg", ".jpeg")]
    return sorted(photos, key=lambda path: natural_key(path.name))


def _check_labels(photos: list[Recording], labels: list[str], manifest: str) -> None:
    unknown = sorted({row.label for row in photos} - set(labels))
    if unknown:
        raise UserError(
            f"Manifest {manifest} names the class {', '.join(unknown)}, of which "
            "Training/Accel has no trace; correct the spelling."
        )


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
Files = dict[str, dict[int, list[Path]]]  # by label and number


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
            UserError: If traces are missing, an axis is, counts differ from ten per class, or
                the senses do not have the same classes.
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
    """Read one recording for each number; all ten of each class have to be there."""
    pattern, example = NAMES.get(modality, OWN)
    found = _numbered(folder, pattern.format(mark))
    if not found and (modality == "haptic" or modality not in MODALITIES):
        raise UserError(
            f"Folder {folder} holds no {example.format(mark)} files; data.root must hold that "
            f"folder (data.reader.folders.{modality})."
        )
    for label, numbers in found.items():
        _check_numbers(folder, label, plural(modality), numbers)
        for files in numbers.values():
            _check_files(files, modality)
    rate = SOUND_RATE if modality == "sound" else RATE if ACCELERATIONS in folder.parts else None
    return [
        Recording(label, modality, files[0], number - 1, rate)
        for label, numbers in found.items()
        for number, files in sorted(numbers.items())
    ]


def _numbered(folder: Path, pattern: str) -> Files:
    """Files below a folder by label and by number of the recording, in the order of names."""
    known = (*TRACE_SUFFIXES, *IMAGE_SUFFIXES)
    found: Files = defaultdict(lambda: defaultdict(list))
    for path in sorted(folder.rglob("*")):
        match = re.fullmatch(pattern, path.name, re.IGNORECASE)
        if match and path.suffix.lower() in known:
            found[match[1]][int(match[2])].append(path)
    return found


def _check_files(files: list[Path], modality: str) -> None:
    """Make sure that the files of one number are one recording: alone, or all its axes."""
    if modality == "haptic":
        for axis in "XYZ":
            file = files[0].with_name(re.sub(r"_[XYZ](_[^_]+)$", rf"_{axis}\1", files[0].name))
            if file not in files:
                raise UserError(
                    f"File {file} does not exist, but other axes of that trace do; copy it again."
                )
    axes = axis_files(files[0])
    for file in files:
        if file not in axes:
            raise UserError(f"Files {files[0]} and {file} have the same number; keep one of them.")


def _check_numbers(folder: Path, label: str, what: str, numbers: dict[int, list[Path]]) -> None:
    expected = set(range(1, PER_CLASS + 1))
    if set(numbers) != expected:
        missing = sorted(expected - set(numbers))
        extra = sorted(set(numbers) - expected)
        listed = f"lacks number {missing}" if missing else f"has number {extra} as well"
        raise UserError(
            f"Folder {folder} must hold the {what} 1 to {PER_CLASS} of {label}, but {listed}; "
            "complete or correct it."
        )
