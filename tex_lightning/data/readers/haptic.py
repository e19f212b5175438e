"""Readers of haptic sets: the Cluster Haptic Texture Dataset and the Penn Toolkit (HaTT).

Cluster (2024): a machine moves a rubber fingertip over 118 surfaces in 8 directions at 5 speeds,
with 2 forces, twice: 160 strokes of a surface. A stroke is
``sensor_data/{sensor}/{id}/{id}_{direction}_{speed}_{force}_{repetition}.csv`` (degrees, mm/s, mN).
``accel`` has the columns ``time,X,Y,Z`` (g), ``force`` ``time,force`` (N), at nominally 6 kHz with
uneven time stamps, which give the rate and are interpolated. ``audio`` is 44.1 kHz WAV,
``raw_audio`` of two channels, of which 0 is the surface's and 1 the machine's.
Class names are the surface ids, because the set's ``texture_list.xlsx`` calls some surfaces alike.

There is one photo of a surface, ``images/images_scan_area/img{id}.jpg`` of 100 x 100 mm. It is
divided into strips side by side, one for each group, so that folds do not share pixels.
``images/crop_images`` is not read: its crops of the same photo overlap. Layout and columns are
those of the set's README; the files were not seen. Its mirror as Parquet is not read.

HaTT: 100 textures stroked with a tool by hand. A recording is an XML file with the acceleration of
about 10 s at 10 kHz (:mod:`..traces`). Its layout was not seen: sources speak of one or of two
recordings of a texture, and of ``RecordedData`` as their folder. So both usual layouts are read:
``TEXTURE/ANY.xml``, and ``TEXTURE_Recording1.xml`` (also ``_Rec1`` or ``_Trial1``) or
``TEXTURE.xml``, side by side; the place of a file in the natural order of names is its number.
Below ``RecordedData``, if there is such a folder, nothing else is looked at, which leaves the
texture models alone. With ``group_by=stretch`` each recording is divided into as many stretches as
there are folds, and a fold is one stretch of all recordings. With ``recording`` a fold is a
recording.
"""

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from tex_lightning.data.decode import IMAGE_SUFFIXES
from tex_lightning.data.readers import GroupedReader, check_same_classes
from tex_lightning.data.recordings import Note, Recording, Recordings, equal_parts, natural_key
from tex_lightning.data.traces import SOUND_SUFFIXES, TRACE_SUFFIXES
from tex_lightning.errors import UserError

CONDITIONS = ("direction", "speed", "force", "repetition")
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
            UserError: If a folder is missing, a file has another name, or senses do not have the
                same classes.
        """
        root = Path(self.root).expanduser()
        folders = {sense: root / name for sense, name in self.folders.items() if name is not None}
        photos = folders.pop("image", None)
        strokes = [
            row for sense, folder in folders.items() for row in self._read_sensor(folder, sense)
        ]
        values = sorted({int(row.group) for row in strokes})
        rows = [replace(row, group=values.index(int(row.group))) for row in strokes]
        notes = []
        if photos is not None and (files := _files(photos, IMAGE_SUFFIXES)):
            count = len(values) or self.groups[self.group_by]
            rows += [
                Recording(_numbers(path, "img")[0], "image", path, group, part=part)
                for path in files
                for group, part in enumerate(equal_parts(count))
            ]
            notes = [_divided("photo", f"{count} strips", "lies", "image")]
        check_same_classes(root, rows)
        return Recordings(tuple(rows), tuple(notes))

    def _read_sensor(self, folder: Path, sense: str) -> list[Recording]:
        """Strokes of one sense, grouped by the value of the condition itself."""
        files = _files(folder, TRACE_SUFFIXES)
        if not files and sense != "sound":
            raise UserError(
                f"Folder {folder} holds no ID/ID_DIRECTION_SPEED_FORCE_REPETITION.csv or .wav; "
                f"correct data.root, or leave it out by data.reader.folders.{sense}=null."
            )
        return [self._stroke(sense, path) for path in files]

    def _stroke(self, sense: str, path: Path) -> Recording:
        label, *values = _numbers(path, "", len(CONDITIONS))
        conditions = dict(zip(CONDITIONS, values, strict=True))
        rate = SOUND_RATE if path.suffix.lower() in SOUND_SUFFIXES else None
        group = int(conditions[self.group_by])
        return Recording(label, sense, path, group, rate, tuple(conditions.items()))


def _files(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Files below a folder, in natural order."""
    files = [path for path in folder.rglob("[!.]*") if path.suffix.lower() in suffixes]
    return sorted(files, key=lambda path: natural_key(str(path)))


def _numbers(path: Path, start: str, more: int = 0) -> list[str]:
    """Surface and values of the conditions out of a name."""
    match = re.fullmatch(rf"{start}(\d+)" + more * r"_(\d+)", path.stem)
    if match is None:
        example = f"{start}0{'_135_40_500_0' if more else ''}{path.suffix}"
        raise UserError(
            f"File {path} is not called {example} or the like; correct its name, or take it out."
        )
    return list(match.groups())


def _divided(what: str, into: str, verb: str, modality: str | None = None) -> Note:
    text = (
        f"Each {what} is divided into {into}, one for each fold: what is tested {verb} beside what "
        "was trained on, which flatters figures."
    )
    return Note(f"divided {what}", 0, text, modality)


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
            UserError: If there are none.
        """
        root = Path(self.root).expanduser()
        folder = root / FOLDER if (root / FOLDER).is_dir() else root
        textures: dict[str, list[Path]] = defaultdict(list)
        for path in _files(folder, (".xml",)):
            stem = re.sub(r"(?i)_(rec|recording|trial)_?\d+$", "", path.stem)
            textures[stem if path.parent == folder else path.parent.name].append(path)
        if not textures:
            raise UserError(
                f"Folder {folder} holds no TEXTURE/RECORDING.xml and no TEXTURE_Recording1.xml; "
                "check data.root."
            )
        whole = [
            Recording(label, "haptic", path, number, conditions=(("recording", str(number + 1)),))
            for label, paths in textures.items()
            for number, path in enumerate(paths)
        ]
        if self.group_by == "recording":
            return Recordings(tuple(whole))
        parts = equal_parts(self.folds)
        rows = (replace(row, group=at, part=part) for row in whole for at, part in enumerate(parts))
        note = _divided("recording", f"{self.folds} stretches", "was recorded")
        return Recordings(tuple(rows), (note,))
