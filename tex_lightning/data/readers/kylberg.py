"""Reader of the Kylberg texture data set v1.0: 28 classes of 160 grey patches.

Files are ``{class}/{class}-{surface}-p{number}.png``; ``surface`` is one of a to d, the four pieces
of material that a class was cut from. The rotated set has ``-r30`` and so on behind the number.
With ``group_by=patch`` the place of a patch in its class decides its fold, so that every fold
has patches of all surfaces, as random divisions have: training and test share them. With
``surface`` a fold is a surface, and nothing is tested whose neighbour was trained on. Rotations of
a patch always stay together.
"""

import re
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

from tex_lightning.data.readers.classes import GroupedReader
from tex_lightning.data.readers.folder import class_folders
from tex_lightning.data.recordings import Recording, Recordings, natural_key
from tex_lightning.errors import UserError

PATCHES = 160
SURFACES = "abcd"  # from which the patches of one class are cut


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
            UserError: If there are none, a file's name does not fit its folder, or a count is
                wrong.
        """
        folders = class_folders(self.root, "kylberg")
        by_surface = self.group_by == "surface"
        rows = tuple(row for folder in folders for row in _read_class(folder, by_surface))
        if not rows:
            raise UserError(f"Folder {self.root} holds no CLASS/CLASS-a-p001.png; check data.root.")
        return Recordings(rows)


def _read_class(folder: Path, by_surface: bool) -> list[Recording]:
    """Recordings of one class; a folder without PNG files is passed over."""
    patches: dict[str, list[Path]] = defaultdict(list)
    for path in sorted(folder.glob("*.png"), key=lambda path: natural_key(path.name)):
        match = re.fullmatch(rf"{re.escape(folder.name)}-([a-d]-p\d+)(-r\d+)?\.png", path.name)
        if match is None:
            raise UserError(
                f"File {path} is not called {folder.name}-a-p001.png or the like, with a surface "
                "from a to d; correct its name, or take it out."
            )
        patches[match[1]].append(path)
    if patches:
        _check_counts(folder, patches)
    places = {name: place for place, name in enumerate(sorted(patches, key=natural_key))}
    return [
        Recording(
            folder.name, "image", path, SURFACES.index(name[0]) if by_surface else places[name]
        )
        for name, paths in patches.items()
        for path in paths
    ]


def _check_counts(folder: Path, patches: dict[str, list[Path]]) -> None:
    if len(patches) != PATCHES:
        raise UserError(
            f"Folder {folder} holds {len(patches)} patches, but a class has {PATCHES}; "
            "copy it again."
        )
    most = max(len(paths) for paths in patches.values())
    for name, paths in patches.items():
        if len(paths) != most:
            raise UserError(
                f"Folder {folder} holds {len(paths)} rotations of patch {name}, but {most} of "
                "others; copy it again."
            )
