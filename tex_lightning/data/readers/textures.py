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
from dataclasses import dataclass
from pathlib import Path

from tex_lightning.data.readers import GroupedReader
from tex_lightning.data.recordings import Recording, Recordings, natural_key
from tex_lightning.errors import UserError

PIECES = "abcd"  # surfaces of Kylberg, samples of KTH


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
        photos = _photos(self.root, "kylberg", "canvas1-a-p001", r".+-([a-d]-p\d+)(-r\d+)?")
        for label, names in photos.items():
            patches = sorted({name for name, _ in names}, key=natural_key)
            by_surface = self.group_by == "surface"
            groups = {
                patch: PIECES.index(patch[0]) if by_surface else place
                for place, patch in enumerate(patches)
            }
            rows += [Recording(label, "image", path, groups[name]) for name, path in names]
        return Recordings(tuple(rows))


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
            UserError: If there is none, or a file's name does not fit.
        """
        pattern = r"\d+([a-d])-scale_\d+_im_\d+_col"
        photos = _photos(self.root, "kth_tips2b", "22a-scale_2_im_1_col", pattern)
        return Recordings(
            tuple(
                Recording(label, "image", path, PIECES.index(sample))
                for label, names in photos.items()
                for sample, path in names
            )
        )


def _photos(root: str, name: str, example: str, pattern: str) -> dict[str, list[tuple[str, Path]]]:
    """Photos of each class, in natural order, with what the pattern finds in their names.

    Args:
        root: Folder of the classes, or the one that holds it called like the data set, so that one
            ``data.root`` serves a sweep over several.
        name: Name of the data set.
        example: Name of a photo without suffix.
        pattern: Pattern of their names without suffix.
    """
    folder = Path(root).expanduser()
    folder = folder / name if (folder / name).is_dir() else folder
    found: dict[str, list[tuple[str, Path]]] = {}
    for path in sorted(folder.rglob("[!.]*.png"), key=lambda path: natural_key(str(path))):
        match = re.fullmatch(pattern, path.stem)
        if match is None:
            raise UserError(
                f"File {path} is not called {example}.png or the like; correct it, or take it out."
            )
        label = path.relative_to(folder).parts[0]
        found.setdefault(label, []).append((match[1], path))
    if not found:
        raise UserError(f"Folder {folder} holds no CLASS/{example}.png; check data.root.")
    return found
