"""Reader of the Penn Haptic Texture Toolkit (HaTT): 100 textures stroked with a tool by hand.

A recording is an XML file with the acceleration of about 10 s at 10 kHz (:mod:`..xml_traces`). Its
layout was not seen: sources speak of one or of two recordings of a texture, and of ``RecordedData``
as their folder. So both usual layouts are read: ``TEXTURE/ANY.xml``, where the place of a file in
the natural order of names is its number, and ``TEXTURE_Recording1.xml`` (also ``_Rec1`` or
``_Trial1``) or ``TEXTURE.xml``, side by side. Below ``RecordedData``, if there is such a folder,
nothing else is looked at, so that the texture models, XML as well, are left alone.

With ``group_by=stretch`` each recording is divided into as many stretches as there are folds, and a
fold is one stretch of all recordings. With ``recording`` a fold is a recording.
"""

import re
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

from tex_lightning.data.parts import equal_parts
from tex_lightning.data.readers.classes import GroupedReader
from tex_lightning.data.recordings import Note, Recording, Recordings, natural_key
from tex_lightning.errors import UserError

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
