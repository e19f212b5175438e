"""Reader of the TUM haptic texture database with 69 classes (LMT-69).

Traces are ``Training/Accel/{label}_query{0..9}.txt``: 10 kHz, already reduced to one axis by
DFT321, one number a line. Photos are ``IMG_*.JPG`` whose names carry no class; their order does:
ten per class, in the order of the class names. Public sources do not name the photo folder, so
the one folder below ``Training`` that holds such photos is taken (``ImageMagnified`` aside). Where
that order does not hold, ``data.manifest`` names the photos' classes instead.
"""

import re
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

from tex_lightning.data.recordings import (
    Recording,
    Recordings,
    natural_key,
    number_files,
    read_manifest,
)
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
