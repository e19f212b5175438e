"""Readers of sets of photos: the Kylberg texture data set and KTH-TIPS-2b.

Kylberg v1.0 has 28 classes of 160 grey patches, ``{class}/{class}-{surface}-p{number}.png``;
``surface`` is one of a to d, the four pieces of material that a class was cut from. The rotated set
has ``-r30`` and so on behind the number. With ``group_by=patch`` the place of a patch in its class
decides its fold, so that every fold has patches of all surfaces, as random divisions have: training
and test share them. With ``surface`` a fold is a surface, and nothing is tested whose neighbour was
trained on. Rotations of a patch always stay together.

KTH-TIPS-2b has 11 classes, 4 samples each, 108 photos of a sample,
``{class}/sample_{a,b,c,d}/{number}{a,b,c,d}-scale_{2..10}_im_{1..12}_col.png``, where the number
belongs to the class. A sample is another piece of the material; it is the group, so that four folds
are the four samples. The paper trains on one sample and tests on the other three
(``data.inverted=true``), newer work the other way round: their figures do not compare.
"""

import re
from collections import defaultdict
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from tex_lightning.config.keys import nearest
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
        rows = tuple(row for folder in folders for row in _read_patches(folder, by_surface))
        if not rows:
            raise UserError(f"Folder {self.root} holds no CLASS/CLASS-a-p001.png; check data.root.")
        return Recordings(rows)


def _read_patches(folder: Path, by_surface: bool) -> list[Recording]:
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


NUMBERS = {
    "aluminium_foil": 15,
    "brown_bread": 48,
    "corduroy": 42,
    "cork": 16,
    "cotton": 46,
    "cracker": 60,
    "lettuce_leaf": 23,
    "linen": 44,
    "white_bread": 52,
    "wood": 54,
    "wool": 22,
}
SAMPLES = "abcd"
SCALES, IMAGES = range(2, 11), range(1, 13)


@dataclass
class KthTips2bReader:
    """KTH-TIPS-2b.

    Attributes:
        root: Folder with a folder for each class, or the one that holds it as ``kth_tips2b``.
    """

    root: str

    def read(self) -> Recordings:
        """Read the classes that have a folder.

        Raises:
            UserError: If there is none, a folder is no class, or photos are missing or too many.
        """
        folders = class_folders(self.root, "kth_tips2b")
        for folder in folders:
            if folder.name not in NUMBERS:
                raise UserError(
                    f"Folder {folder} is no class of KTH-TIPS-2b{nearest(folder.name, NUMBERS)}; "
                    f"they are {', '.join(NUMBERS)}."
                )
        if not folders:
            raise UserError(
                f"Folder {self.root} holds none of the classes {', '.join(NUMBERS)}; check "
                "data.root."
            )
        parts = product(folders, enumerate(SAMPLES))
        rows = [row for folder, sample in parts for row in _read_sample(folder, *sample)]
        return Recordings(tuple(rows))


def _read_sample(folder: Path, group: int, sample: str) -> list[Recording]:
    directory = folder / f"sample_{sample}"
    start = f"{NUMBERS[folder.name]}{sample}"
    expected = [f"{start}-scale_{s}_im_{i}_col.png" for s in SCALES for i in IMAGES]
    found = {path.name for path in directory.glob("*.png")}
    missing = [name for name in expected if name not in found]
    extra = sorted(found - set(expected))
    if missing or extra:
        wrong = f"lacks {missing[0]}" if missing else f"has {extra[0]}, which does not belong there"
        raise UserError(
            f"Folder {directory} holds {len(found)} photos where {len(expected)} are needed; it "
            f"{wrong}; copy it again."
        )
    return [Recording(folder.name, "image", directory / name, group) for name in expected]
