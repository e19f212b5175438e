"""Reader of the LMT-108 surface material database.

Accelerations are ``AccelScansComponents/Movement/.../{label}_Movement_{X,Y,Z}_train{n}.txt``:
10 kHz, one axis a file, which decoding puts together. Photos are
``ImageScans/NoFlash/.../{label}_Image_{i}_train{n}.jpg``. Ten recordings per class are for
training and ten for testing (``test`` instead of ``train``); ``split`` says which of the two
are read. The number of a recording decides its fold.
"""

import re
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

from tex_lightning.config.check_ranges import choice
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.errors import UserError

PER_CLASS = 10
RATE = 10_000.0
MARKS = {"training": "train", "testing": "test"}
FOLDERS: dict[str, Path] = {
    "haptic": Path("AccelScansComponents/Movement"),
    "image": Path("ImageScans/NoFlash"),
}


@dataclass
class Lmt108Reader:
    """LMT-108.

    Attributes:
        root: Folder of the database.
        split: Half that is read, ``training`` or ``testing``.

    Raises:
        UserError: If there is no such half.
    """

    root: str
    split: str

    def __post_init__(self) -> None:
        for complaint in choice("data.reader.split", self.split, tuple(MARKS)):
            raise UserError(f"{complaint}.")

    def read(self) -> Recordings:
        """Read traces and photos of one half; without any photos, traces alone.

        Raises:
            UserError: If traces are missing, an axis is, counts differ from ten per class, or
                photos and traces do not have the same classes.
        """
        root, mark = Path(self.root).expanduser(), MARKS[self.split]
        traces = _read_traces(root / FOLDERS["haptic"], mark)
        photos = _read_photos(root / FOLDERS["image"], mark)
        if photos:
            _check_same(root, {row.label for row in traces}, {row.label for row in photos})
        return Recordings((*traces, *photos))


def _read_traces(folder: Path, mark: str) -> list[Recording]:
    """One recording for the X file of each trace, after making sure that Y and Z exist."""
    found = _numbered(folder, rf"(.+)_Movement_[XYZ]_{mark}(\d+)\.txt")
    if not found:
        raise UserError(
            f"Folder {folder} holds no LABEL_Movement_X_{mark}1.txt files; data.root must hold "
            f"{FOLDERS['haptic']}."
        )
    for label, numbers in found.items():
        _check_numbers(folder, label, "traces", numbers)
        for number, files in numbers.items():
            for axis in "XYZ":
                name = f"{label}_Movement_{axis}_{mark}{number}.txt"
                if name not in [file.name for file in files]:
                    raise UserError(
                        f"File {files[0].with_name(name)} does not exist, but other axes of that "
                        "trace do; copy it again."
                    )
    return _recordings("haptic", found, RATE)


def _read_photos(folder: Path, mark: str) -> list[Recording]:
    found = _numbered(folder, rf"(.+)_Image_\d+_{mark}(\d+)\.jpg")
    for label, numbers in found.items():
        _check_numbers(folder, label, "photos", numbers)
        for files in numbers.values():
            if len(files) > 1:
                raise UserError(
                    f"Files {files[0]} and {files[1]} have the same number; keep one of them."
                )
    return _recordings("image", found, None)


def _numbered(folder: Path, pattern: str) -> dict[str, dict[int, list[Path]]]:
    """Files below a folder by label and by number of the recording, in the order of names."""
    found: dict[str, dict[int, list[Path]]] = defaultdict(lambda: defaultdict(list))
    for path in sorted(folder.rglob("*")):
        match = re.fullmatch(pattern, path.name, re.IGNORECASE)
        if match:
            found[match[1]][int(match[2])].append(path)
    return found


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


def _recordings(
    modality: str, found: dict[str, dict[int, list[Path]]], rate: float | None
) -> list[Recording]:
    return [
        Recording(label, modality, files[0], number - 1, rate)
        for label, numbers in found.items()
        for number, files in sorted(numbers.items())
    ]


def _check_same(root: Path, traces: set[str], photos: set[str]) -> None:
    for one, other, what in ((traces, photos, "photos"), (photos, traces, "traces")):
        if one - other:
            raise UserError(
                f"Folder {root} has no {what} of {', '.join(sorted(one - other))}; is the name "
                f"spelt differently there ({', '.join(sorted(other - one)) or 'no other name'})?"
            )
