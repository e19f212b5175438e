"""Reader of the Cluster Haptic Texture Dataset (2024): 118 surfaces under a rubber fingertip.

A machine moves the fingertip in 8 directions at 5 speeds, with 2 forces, twice: 160 strokes of a
surface. A stroke is ``sensor_data/{sensor}/{id}/{id}_{direction}_{speed}_{force}_{repetition}.csv``
(degrees, mm/s, mN). ``accel`` has the columns ``time,X,Y,Z`` (g), ``force`` ``time,force`` (N), at
nominally 6 kHz with uneven time stamps, which give the rate and are interpolated. ``audio`` is
44.1 kHz WAV, ``raw_audio`` of two channels, of which ``decode.channel=0`` is the surface's and 1
the machine's. ``position`` (``time,X,Y``, mm) is refused by decoding: it has two axes, and 100
stamps a second, whose unit its column does not say. Class names are the surface ids, because the
set's ``texture_list.xlsx`` calls some surfaces alike.

There is one photo of a surface, ``images/images_scan_area/img{id}.jpg`` of 100 x 100 mm. It is
divided into strips side by side, one for each group, so that folds do not share pixels.
``images/crop_images`` is not read: its crops of the same photo overlap. The size of the photos is
documented nowhere.

The layout and columns are those of the set's README; the files themselves were not seen. A mirror
of it keeps the tables as Parquet, which is not read.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from tex_lightning.core.files import is_file, require_file
from tex_lightning.data.decode import IMAGE_SUFFIXES
from tex_lightning.data.parts import equal_parts
from tex_lightning.data.readers.classes import GroupedReader, check_same_classes
from tex_lightning.data.recordings import (
    MODALITIES,
    Note,
    Recording,
    Recordings,
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
