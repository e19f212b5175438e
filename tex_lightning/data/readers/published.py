"""Readers of published data sets, by the names of their files.

- **TUM** (LMT-69): ``Training/Accel/{label}_query{0..9}.txt``, 10 kHz, already reduced to one axis
  by DFT321. Photos ``IMG_*.JPG`` carry no class; their order does: ten per class, in the order of
  the class names. The one folder below ``Training`` that holds such photos is taken
  (``ImageMagnified`` aside). Where that order does not hold, ``data.manifest`` names their classes.
- **LMT-108**: ``AccelScansComponents/Movement/.../{label}_Movement_{X,Y,Z}_train{n}.txt``, 10 kHz,
  an axis a file, which decoding joins; ``ImageScans/NoFlash/.../{label}_Image_{i}_train{n}.jpg``;
  ``SoundScans/Movement/.../{label}_Sound_Movement_train{n}.wav``, 44.1 kHz; ``test`` for the other
  half. The number decides the fold. Any other folder, such as ``AccelScansComponents/Tapping``, can
  be a sense of the user's own, of files ``{label}_{words}_train{n}``; their names were not seen.
- **Cluster** (2024): a machine moves a rubber fingertip over 118 surfaces, 160 strokes each,
  ``sensor_data/{sensor}/{id}/{id}_{direction}_{speed}_{force}_{repetition}.csv`` (degrees, mm/s,
  mN), ``accel`` (g) and ``force`` (N) at nominally 6 kHz with time stamps, ``audio`` 44.1 kHz WAV,
  ``raw_audio`` of two channels. The one photo of a surface, ``images/images_scan_area/img{id}.jpg``
  of 100 x 100 mm, is divided into strips, one for each group, so that folds do not share pixels.
  Layout and columns are those of the set's README; the files were not seen.
- **HaTT**: 100 textures stroked by hand, about 10 s each as XML (:mod:`..traces`), either
  ``TEXTURE/ANY.xml``, or ``TEXTURE_Recording1.xml`` (``_Rec1``, ``_Trial1``) or ``TEXTURE.xml``
  side by side, below ``RecordedData`` if there is such a folder. Its layout was not seen. With
  ``group_by=stretch`` each recording is divided into as many stretches as there are folds.
- **Kylberg** v1.0: 28 classes of 160 grey patches, ``{class}/{class}-{surface}-p{number}.png``, of
  four surfaces a to d, the rotated set with ``-r30`` and so on behind the number. With
  ``group_by=patch`` every fold has patches of all surfaces, as random divisions have; with
  ``surface`` nothing is tested whose neighbour was trained on. Rotations stay together.
- **KTH-TIPS-2b**: 11 classes of 4 samples, 108 photos of a sample,
  ``{class}/sample_{a..d}/{number}{a..d}-scale_{2..10}_im_{1..12}_col.png``. A sample is the group.
  The paper trains on one sample and tests on three (``data.inverted=true``).
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tex_lightning.config.keys import choice
from tex_lightning.data.decode import IMAGE_SUFFIXES
from tex_lightning.data.recordings import (
    Note,
    Recording,
    Recordings,
    equal_parts,
    natural_key,
    number_files,
    plural,
    read_manifest,
)
from tex_lightning.data.traces import SOUND_SUFFIXES, TRACE_SUFFIXES, axis_files
from tex_lightning.errors import UserError, listed

RATE, SOUND_RATE = 10_000.0, 44_100.0
PIECES = "abcd"  # surfaces of Kylberg, samples of KTH
Named = list[tuple[re.Match[str], Path]]


@dataclass
class PublishedReader:
    """Reader of a published data set; its fields are its keys.

    Attributes:
        root: Folder of the data set.
    """

    root: str

    @property
    def folder(self) -> Path:
        """Folder of the data set."""
        return Path(self.root).expanduser()


@dataclass
class GroupedReader(PublishedReader):
    """Reader of a data set whose recordings can be grouped in several ways.

    Attributes:
        root: Folder of the data set.
        group_by: What makes a group, and so a fold.
        groups: What ``group_by`` may be, and how many groups that usually makes.

    Raises:
        UserError: If ``group_by`` is unknown.
    """

    group_by: str
    groups: Mapping[str, int]

    def __post_init__(self) -> None:
        _check_choice("data.group_by", self.group_by, tuple(self.groups))


def _check_choice(key: str, value: str, choices: Sequence[str]) -> None:
    for complaint in choice(key, value, tuple(choices)):
        raise UserError(f"{complaint}.")


def _named(folder: Path, suffixes: Sequence[str], pattern: str, example: str | None) -> Named:
    """List the files below a folder whose names without suffix fit a pattern, in natural order.

    Args:
        folder: Folder of the files.
        suffixes: Suffixes of the files, in lower case.
        pattern: Pattern of their names, without suffix.
        example: Such a name, for messages; None passes over files with other names.

    Raises:
        UserError: If a file has another name.
    """
    named: Named = []
    for path in sorted(folder.rglob("[!.]*"), key=lambda path: natural_key(str(path))):
        if path.suffix.lower() not in suffixes:
            continue
        if match := re.fullmatch(pattern, path.stem):
            named.append((match, path))
        elif example is not None:
            raise UserError(
                f"File {path} is not called {example}{path.suffix} or the like; correct its name, "
                "or take it out."
            )
    return named


def _check_same_classes(root: Path, rows: Iterable[Recording]) -> None:
    """Refuse senses that do not have the same classes.

    Raises:
        UserError: Naming the classes and the sense that lacks them.
    """
    labels: dict[str, set[str]] = defaultdict(set)
    for row in rows:
        labels[row.modality].add(row.label)
    every = set[str]().union(*labels.values())
    for modality, names in reversed(labels.items()):
        if missing := sorted(every - names):
            raise UserError(
                f"Folder {root} has no {plural(modality)} of {listed(missing)}; correct the names, "
                f"or leave them out by data.reader.folders.{modality}=null."
            )


def _divided(what: str, into: str, verb: str, modality: str | None = None) -> Note:
    text = (
        f"Each {what} is divided into {into}, one for each fold: what is tested {verb} beside what "
        "was trained on, which overestimates figures."
    )
    return Note(text, modality)


@dataclass
class TumReader(PublishedReader):
    """The TUM haptic texture database.

    Attributes:
        root: Folder of the database.
        manifest: File that names the photos' classes; None where their order does.
    """

    manifest: str | None
    per_class = 10  # photos

    def read(self) -> Recordings:
        """Read the training part of the database.

        Raises:
            UserError: If there are no traces, or photos whose classes cannot be told by their
                order.
        """
        training = self.folder / "Training"
        files: dict[str, list[Path]] = defaultdict(list)
        for match, path in _named(training / "Accel", (".txt",), r"(.+)_query\d+", None):
            files[match[1]].append(path)
        if not files:
            raise UserError(
                f"Folder {training / 'Accel'} holds no LABEL_query0.txt files; check data.root."
            )
        rows = [row for label in files for row in number_files(label, "haptic", files[label], RATE)]
        if self.manifest is not None:
            photos = read_manifest(Path(self.manifest).expanduser()).of("image").rows
        else:
            photos = self._photos(training, sorted(files, key=natural_key))
        return Recordings((*rows, *photos))

    def _photos(self, training: Path, labels: list[str]) -> tuple[Recording, ...]:
        """Read photos by sorted order; none at all is allowed, since HapticNet needs none."""
        folders: dict[Path, list[Path]] = defaultdict(list)
        for _, path in _named(training, (".jpg", ".jpeg"), ".+", None):
            if path.parent.name != "ImageMagnified":
                folders[path.parent].append(path)
        expected = self.per_class * len(labels)
        if folders and [len(paths) for paths in folders.values()] != [expected]:
            told = " and ".join(f"{len(paths)} in {x.name}" for x, paths in folders.items())
            raise UserError(
                f"Folder {training} holds the photos {told}, but {len(labels)} classes need "
                f"{expected} in one folder; correct that, or name their classes in data.manifest."
            )
        return tuple(
            Recording(labels[number // self.per_class], "image", path, number % self.per_class)
            for paths in folders.values()
            for number, path in enumerate(paths)
        )


MARKS = {"training": "train", "testing": "test"}
# what stands between label and mark, and an example with suffix
LMT108_NAMES = {
    "haptic": (r"(?i)(.+)_Movement_[XYZ]_{}(\d+)", "LABEL_Movement_X_{}1.txt"),
    "image": (r"(?i)(.+)_Image_\d+_{}(\d+)", "LABEL_Image_1_{}1.jpg"),
    "sound": (r"(?i)(.+)_Sound_Movement_{}(\d+)", "LABEL_Sound_Movement_{}1.wav"),
}
CUSTOM_NAMES = (r"(?i)([^_]+(?:_\d+)?)_.*?{}(\d+)", "LABEL_Tapping_X_{}1.txt")


@dataclass
class Lmt108Reader(PublishedReader):
    """LMT-108.

    Attributes:
        root: Folder of the database.
        split: Half that is read, ``training`` or ``testing``.
        folders: Folder of each sense, below ``root``; None leaves it out. That of photos or sounds
            may be missing.

    Raises:
        UserError: If there is no such half.
    """

    split: str
    folders: Mapping[str, str | None]

    def __post_init__(self) -> None:
        _check_choice("data.reader.split", self.split, tuple(MARKS))

    def read(self) -> Recordings:
        """Read all senses of one half; without photos or sounds, the others alone.

        Raises:
            UserError: If traces are missing, an axis is, or the senses do not have the same
                classes.
        """
        rows: list[Recording] = []
        for modality, name in self.folders.items():
            if name is not None:
                rows += self._read_sense(self.folder / name, modality)
        _check_same_classes(self.folder, rows)
        return Recordings(tuple(rows))

    def _read_sense(self, folder: Path, modality: str) -> list[Recording]:
        """Read one recording for each number."""
        pattern, example = (
            text.format(MARKS[self.split]) for text in LMT108_NAMES.get(modality, CUSTOM_NAMES)
        )
        suffixes = (*TRACE_SUFFIXES, *IMAGE_SUFFIXES)
        numbered: dict[tuple[str, int], list[Path]] = defaultdict(list)
        for match, path in _named(folder, suffixes, pattern, None):
            numbered[match[1], int(match[2])].append(path)
        if not numbered and modality not in ("image", "sound"):
            raise UserError(
                f"Folder {folder} holds no {example} files; data.root must hold that folder "
                f"(data.reader.folders.{modality})."
            )
        acceleration = "AccelScansComponents" in folder.parts
        rate = SOUND_RATE if modality == "sound" else RATE if acceleration else None
        rows = []
        for (label, number), files in sorted(numbered.items()):
            whole = axis_files(files[0])
            if tuple(files) != whole or (modality == "haptic" and len(whole) != 3):
                raise UserError(
                    f"Recording {number} of {label} in {folder} is "
                    f"{', '.join(file.name for file in files)}; a recording is one file, or one "
                    "for each axis X, Y and Z: copy it again."
                )
            rows.append(Recording(label, modality, files[0], number - 1, rate))
        return rows


CONDITIONS = ("direction", "speed", "force", "repetition")


@dataclass
class ClusterReader(GroupedReader):
    """The Cluster Haptic Texture Dataset; a class is named by the number of its surface.

    Attributes:
        root: Folder with ``sensor_data`` and ``images``.
        folders: Folder of each sense, below ``root``; None leaves it out. That of sounds or photos
            may be missing.
        group_by: Condition whose values make the groups, and so the folds.
    """

    folders: Mapping[str, str | None]

    def read(self) -> Recordings:
        """Read all senses; group numbers count the values of the condition that are there.

        Raises:
            UserError: If a folder is missing, a file has another name, or senses do not have the
                same classes.
        """
        folders = {name: self.folder / path for name, path in self.folders.items() if path}
        photos = folders.pop("image", None)
        strokes = [row for sense in folders for row in self._read_sensor(folders[sense], sense)]
        values = sorted({int(row.group) for row in strokes})
        rows = [replace(row, group=values.index(int(row.group))) for row in strokes]
        notes = []
        if photos and (named := _named(photos, IMAGE_SUFFIXES, r"img(\d+)", "img0")):
            parts = equal_parts(len(values) or self.groups[self.group_by])
            rows += [
                Recording(match[1], "image", path, group, part=part)
                for match, path in named
                for group, part in enumerate(parts)
            ]
            notes = [_divided("photo", f"{len(parts)} strips", "lies", "image")]
        _check_same_classes(self.folder, rows)
        return Recordings(tuple(rows), tuple(notes))

    def _read_sensor(self, folder: Path, sense: str) -> list[Recording]:
        """Read the strokes of one sense, grouped by the value of the condition itself."""
        named = _named(folder, TRACE_SUFFIXES, r"(\d+)" + 4 * r"_(\d+)", "0_135_40_500_0")
        if not named and sense != "sound":
            raise UserError(
                f"Folder {folder} holds no ID/ID_DIRECTION_SPEED_FORCE_REPETITION.csv or .wav; "
                f"correct data.root, or leave it out by data.reader.folders.{sense}=null."
            )
        rows = []
        for match, path in named:
            label, *values = match.groups()
            conditions = dict(zip(CONDITIONS, values, strict=True))
            rate = SOUND_RATE if path.suffix.lower() in SOUND_SUFFIXES else None
            group = int(conditions[self.group_by])
            rows.append(Recording(label, sense, path, group, rate, tuple(conditions.items())))
        return rows


@dataclass
class HattReader(GroupedReader):
    """The Penn Haptic Texture Toolkit.

    Attributes:
        root: Folder with the recordings, or the one that holds them as ``RecordedData``.
        group_by: What makes a fold: a ``stretch`` of every recording, or a ``recording``.
        folds: Number of folds, and so of stretches.
    """

    folds: int

    def read(self) -> Recordings:
        """Read all textures.

        Raises:
            UserError: If there are none.
        """
        inner = self.folder / "RecordedData"
        folder = inner if inner.is_dir() else self.folder
        textures: dict[str, list[Path]] = defaultdict(list)
        for match, path in _named(
            folder, (".xml",), r"(?i)(.+?)(_(rec|recording|trial)_?\d+)?", None
        ):
            textures[match[1] if path.parent == folder else path.parent.name].append(path)
        if not textures:
            raise UserError(
                f"Folder {folder} holds no TEXTURE/RECORDING.xml and no TEXTURE_Recording1.xml; "
                "check data.root."
            )
        rows = [
            Recording(label, "haptic", path, number, conditions=(("recording", str(number + 1)),))
            for label, paths in textures.items()
            for number, path in enumerate(paths)
        ]
        if self.group_by == "recording":
            return Recordings(tuple(rows))
        parts = list(enumerate(equal_parts(self.folds)))
        stretches = (replace(row, group=at, part=part) for row in rows for at, part in parts)
        note = _divided("recording", f"{self.folds} stretches", "was recorded")
        return Recordings(tuple(stretches), (note,))


@dataclass
class KylbergReader(GroupedReader):
    """The Kylberg texture data set.

    Attributes:
        root: Folder with a folder for each class, or the one that holds it as ``kylberg``.
        group_by: What makes a fold: ``patch`` of all surfaces, or one of four source ``surface``s.
    """

    def read(self) -> Recordings:
        """Read all classes, one folder each.

        Raises:
            UserError: If there are none, or a file's name does not fit.
        """
        rows: list[Recording] = []
        pattern = r".+-([a-d]-p\d+)(-r\d+)?"
        for label, named in _photos(self.folder, "kylberg", "canvas1-a-p001", pattern).items():
            patches = sorted({match[1] for match, _ in named}, key=natural_key)
            groups = {patch: number for number, patch in enumerate(patches)}
            if self.group_by == "surface":
                groups = {patch: PIECES.index(patch[0]) for patch in patches}
            rows += [Recording(label, "image", path, groups[match[1]]) for match, path in named]
        return Recordings(tuple(rows))


@dataclass
class KthTips2bReader(PublishedReader):
    """KTH-TIPS-2b.

    Attributes:
        root: Folder with a folder for each class, or the one that holds it as ``kth_tips2b``.
    """

    def read(self) -> Recordings:
        """Read the classes that have a folder.

        Raises:
            UserError: If there is none, or a file's name does not fit.
        """
        pattern = r"\d+([a-d])-scale_\d+_im_\d+_col"
        classes = _photos(self.folder, "kth_tips2b", "22a-scale_2_im_1_col", pattern)
        rows = [
            Recording(label, "image", path, PIECES.index(match[1]))
            for label, named in classes.items()
            for match, path in named
        ]
        return Recordings(tuple(rows))


def _photos(folder: Path, name: str, example: str, pattern: str) -> dict[str, Named]:
    """List the photos of each class below a folder, or below the folder ``name`` inside it.

    So one ``data.root`` serves a sweep over several data sets.
    """
    folder = folder / name if (folder / name).is_dir() else folder
    classes: dict[str, Named] = defaultdict(list)
    for match, path in _named(folder, (".png",), pattern, example):
        classes[path.relative_to(folder).parts[0]].append((match, path))
    if not classes:
        raise UserError(f"Folder {folder} holds no CLASS/{example}.png; check data.root.")
    return classes
