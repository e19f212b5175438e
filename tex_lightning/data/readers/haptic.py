"""Readers of haptic sets: the Cluster Haptic Texture Dataset and the Penn Toolkit (HaTT).

Cluster (2024): a machine moves a rubber fingertip over 118 surfaces in 8 directions at 5 speeds,
with 2 forces, twice: 160 strokes of a surface. A stroke is
``sensor_data/{sensor}/{id}/{id}_{direction}_{speed}_{force}_{repetition}.csv`` (degrees, mm/s, mN).
``accel`` has the columns ``time,X,Y,Z`` (g), ``force`` ``time,force`` (N), at nominally 6 kHz with
uneven time stamps, which give the rate and are interpolated. ``audio`` is 44.1 kHz WAV,
``raw_audio`` of two channels, of which ``decode.channel=0`` is the surface's and 1 the machine's.
``position`` (``time,X,Y``, mm) is refused by decoding: it has two axes, and 100 stamps a second.
Class names are the surface ids, because the set's ``texture_list.xlsx`` calls some surfaces alike.

There is one photo of a surface, ``images/images_scan_area/img{id}.jpg`` of 100 x 100 mm. It is
divided into strips side by side, one for each group, so that folds do not share pixels.
``images/crop_images`` is not read: its crops of the same photo overlap. Layout and columns are
those of the set's README; the files were not seen. Its mirror as Parquet is not read.

HaTT: 100 textures stroked with a tool by hand. A recording is an XML file with the acceleration of
about 10 s at 10 kHz (:mod:`..trace_files`). Its layout was not seen: sources speak of one or of two
recordings of a texture, and of ``RecordedData`` as their folder. So both usual layouts are read:
``TEXTURE/ANY.xml``, where the place of a file in the natural order of names is its number, and
``TEXTURE_Recording1.xml`` (also ``_Rec1`` or ``_Trial1``) or ``TEXTURE.xml``, side by side. Below
``RecordedData``, if there is such a folder, nothing else is looked at, which leaves the texture
models alone. With ``group_by=stretch`` each recording is divided into as many stretches as there
are folds, and a fold is one stretch of all recordings. With ``recording`` a fold is a recording.
"""

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from tex_lightning.core.files import is_file, require_file
from tex_lightning.data.decode import IMAGE_SUFFIXES
from tex_lightning.data.readers.classes import GroupedReader, check_same_classes
from tex_lightning.data.recordings import (
    MODALITIES,
    Note,
    Recording,
    Recordings,
    equal_parts,
    natural_key,
)
from tex_lightning.data.trace_files import SOUND_SUFFIXES, TRACE_SUFFIXES
from tex_lightning.errors import UserError, reason, shorten

CONDITIONS = {
    "direction": tuple(range(0, 360, 45)),
    "speed": (20, 30, 40, 50, 60),
    "force": (500, 1000),
    "repetition": (0, 1),
}
NAME = "ID_DIRECTION_SPEED_FORCE_REPETITION"
HEADERS = {"accel": "time,X,Y,Z", "force": "time,force", "position": "time,X,Y"}  # of a sensor
SOUND_RATE = 44_100.0


@dataclass
class ClusterReader(GroupedReader):
    """The Cluster Haptic Texture Dataset.

    Attributes:
        root: Folder with ``sensor_data`` and ``images``.
        folders: Folder of each sense, below ``root``; None leaves it out. That of sounds or photos
            may be missing.
        group_by: Condition whose values make the groups, and so the folds: ``direction``,
            ``speed``, ``force`` or ``repetition``.
    """

    folders: Mapping[str, str | None]

    def read(self) -> Recordings:
        """Read all senses; group numbers count the values of the condition that are there.

        Raises:
            UserError: If a folder or a column is missing, a file has another name or number twice,
                or senses do not have the same classes.
        """
        root = Path(self.root).expanduser()
        folders = {sense: root / name for sense, name in self.folders.items() if name is not None}
        photos = folders.pop("image", None)
        strokes = [
            row for sense, folder in folders.items() for row in self._read_sensor(folder, sense)
        ]
        values = sorted({int(row.group) for row in strokes}) or list(CONDITIONS[self.group_by])
        rows = [replace(row, group=values.index(int(row.group))) for row in strokes]
        if photos is not None:
            rows += _read_photos(photos, len(values))
        if not rows:
            raise UserError(
                f"Folder {root} holds none of {', '.join(self.folders)}; check data.root."
            )
        check_same_classes(root, rows)
        has_photos = any(row.modality == "image" for row in rows)
        return Recordings(tuple(rows), (self._note(len(values)),) if has_photos else ())

    def _read_sensor(self, folder: Path, sense: str) -> list[Recording]:
        """Strokes of one sense, grouped by the value of the condition itself."""
        if not folder.is_dir():
            if sense in MODALITIES and sense != "haptic":
                return []
            raise UserError(
                f"Folder {folder} does not exist; data.root must hold it, or leave it out by "
                f"data.reader.folders.{sense}=null."
            )
        found: dict[tuple[str, tuple[int, ...]], Path] = {}
        for path in _files(folder, TRACE_SUFFIXES):
            label, *values = _numbers(path)
            stroke = (str(label), tuple(values))
            if (other := found.setdefault(stroke, path)) != path:
                raise UserError(f"Files {other} and {path} are one stroke; keep one of them.")
            _check_header(path, folder.name)
        if not found:
            raise UserError(f"Folder {folder} holds no ID/{NAME}.csv or .wav; copy it again.")
        return [self._stroke(sense, *stroke, path) for stroke, path in found.items()]

    def _stroke(self, sense: str, label: str, values: tuple[int, ...], path: Path) -> Recording:
        group = dict(zip(CONDITIONS, values, strict=True))[self.group_by]
        rate = SOUND_RATE if path.suffix.lower() in SOUND_SUFFIXES else None
        conditions = tuple(zip(CONDITIONS, map(str, values), strict=True))
        return Recording(label, sense, path, group, rate, conditions)

    def _note(self, count: int) -> Note:
        text = (
            f"There is one photo of a surface, so it is divided into {count} strips, one for each "
            f"group (data.group_by={self.group_by}): what is tested lies beside what was "
            "trained on, which flatters figures of photos."
        )
        return Note("divided photo", 0, text, "image")


def _files(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Files below a folder, in natural order."""
    files = [path for path in folder.rglob("[!.]*") if path.suffix.lower() in suffixes]
    return sorted(files, key=lambda path: natural_key(str(path)))


def _numbers(path: Path) -> list[int]:
    """Surface and values of the conditions out of a name."""
    match = re.fullmatch(r"(\d+)_(\d+)_(\d+)_(\d+)_(\d+)", path.stem)
    if match is None:
        raise UserError(
            f"File {path} is not called {NAME}{path.suffix}, such as 0_135_40_500_0{path.suffix}; "
            "correct its name, or take it out."
        )
    numbers = [int(number) for number in match.groups()]
    if path.parent.name != str(numbers[0]):
        raise UserError(
            f"File {path} of surface {numbers[0]} lies in the folder {path.parent.name}; move it "
            "to its own."
        )
    for (name, values), number in zip(CONDITIONS.items(), numbers[1:], strict=True):
        if number not in values:
            raise UserError(
                f"File {path} has the {name} {number}, but there are {', '.join(map(str, values))};"
                " correct its name, or take it out."
            )
    return numbers


def _check_header(path: Path, sensor: str) -> None:
    """Compare the columns of a table with those of the sensor; decoding refuses an empty one."""
    if path.suffix.lower() != ".csv" or sensor not in HEADERS:
        return
    if not is_file(path):
        require_file(path)
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as stream:
            header = re.sub(r"[\s\"]", "", stream.readline(1000))
    except OSError as error:
        raise UserError(f"File {path} cannot be read ({reason(error)}); replace it.") from error
    if header and header != HEADERS[sensor]:
        raise UserError(
            f"File {path} begins with {shorten(repr(header))} where the columns {HEADERS[sensor]} "
            "are needed; copy it again."
        )


def _read_photos(folder: Path, count: int) -> list[Recording]:
    """Strips of each photo, one for each group."""
    crops = folder.with_name("crop_images")
    if not folder.is_dir() and crops.is_dir():
        raise UserError(
            f"Folder {folder} does not exist, and the crops in {crops} overlap, so that folds "
            "would share pixels; copy the whole photos, or leave them out by "
            "data.reader.folders.image=null."
        )
    rows = []
    for path in _files(folder, IMAGE_SUFFIXES):
        match = re.fullmatch(r"img(\d+)", path.stem)
        if match is None:
            raise UserError(
                f"File {path} is not called imgID.jpg, such as img0.jpg; correct its name, or take "
                "it out."
            )
        rows += [
            Recording(match[1], "image", path, group, part=part)
            for group, part in enumerate(equal_parts(count))
        ]
    return rows


FOLDER = "RecordedData"


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
            UserError: If there are none, or two files are one recording.
        """
        textures = _textures(Path(self.root).expanduser())
        rows = [
            row
            for label, files in textures.items()
            for place, (number, path) in enumerate(sorted(files.items()))
            for row in self._rows(label, place, number, path)
        ]
        return Recordings(tuple(rows), self._notes())

    def _rows(self, label: str, place: int, number: int, path: Path) -> list[Recording]:
        conditions = (("recording", str(number)),)
        if self.group_by == "recording":
            return [Recording(label, "haptic", path, place, conditions=conditions)]
        return [
            Recording(label, "haptic", path, fold, conditions=conditions, part=part)
            for fold, part in enumerate(equal_parts(self.folds))
        ]

    def _notes(self) -> tuple[Note, ...]:
        if self.group_by == "recording":
            return ()
        text = (
            f"Each recording is divided into {self.folds} stretches, one for each fold: what is "
            "tested was recorded just before or after what was trained on, which flatters figures."
        )
        return (Note("divided recording", 0, text),)


def _textures(root: Path) -> dict[str, dict[int, Path]]:
    """Files by texture and number."""
    folder = root / FOLDER if (root / FOLDER).is_dir() else root
    if not folder.is_dir():
        raise UserError(f"Folder {root} does not exist; data.root must hold {FOLDER}.")
    files = [path for path in folder.rglob("[!.]*") if path.suffix.lower() == ".xml"]
    if not files:
        raise UserError(
            f"Folder {folder} holds no TEXTURE/RECORDING.xml and no TEXTURE_Recording1.xml; check "
            "data.root."
        )
    found: dict[str, dict[int, Path]] = defaultdict(dict)
    for path in sorted(files, key=lambda path: natural_key(str(path))):
        if path.parent != folder:
            label, number = path.parent.name, len(found[path.parent.name]) + 1
        else:
            match = re.fullmatch(r"(?i)(.+?)_(?:rec|recording|trial)_?(\d+)", path.stem)
            label, number = (match[1], int(match[2])) if match else (path.stem, 1)
        if (other := found[label].setdefault(number, path)) != path:
            raise UserError(
                f"Files {other} and {path} are both recording {number} of {label}; keep one."
            )
    return found
