"""Reader of the LMT-108 surface material database.

Accelerations are ``AccelScansComponents/Movement/.../{label}_Movement_{X,Y,Z}_train{n}.txt``:
10 kHz, one axis a file, which decoding puts together. Photos are
``ImageScans/NoFlash/.../{label}_Image_{i}_train{n}.jpg``, sounds of the same strokes
``SoundScans/Movement/.../{label}_Sound_Movement_train{n}.wav``, 44.1 kHz. Ten recordings per class
are for training and ten for testing (``test`` instead of ``train``); ``split`` says which of the
two are read. The number of a recording decides its fold.

The database has more folders, such as ``AccelScansComponents/Tapping`` and ``FricScans/FSR1``. Any
can be a sense of the user's own, whose files are ``{label}_{words}_train{n}`` with or without an
axis, as those of ``Movement`` are. Their exact names were read nowhere. Nor were the rates of those
that are no accelerations: they are what ``data.file_rate`` says.
"""

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tex_lightning.config.check_ranges import choice
from tex_lightning.data.decode import IMAGE_SUFFIXES
from tex_lightning.data.readers.classes import check_same_classes
from tex_lightning.data.recordings import MODALITIES, Recording, Recordings, plural
from tex_lightning.data.trace_files import TRACE_SUFFIXES, axis_files
from tex_lightning.errors import UserError

PER_CLASS = 10
ACCELERATIONS, RATE = "AccelScansComponents", 10_000.0
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
