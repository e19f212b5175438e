"""Reader of KTH-TIPS-2b: 11 classes, 4 samples each, 108 photos of a sample.

Files are ``{class}/sample_{a,b,c,d}/{number}{a,b,c,d}-scale_{2..10}_im_{1..12}_col.png``, where the
number belongs to the class. A sample is another piece of the material; it is the group, so that
four folds are the four samples. The paper trains on one sample and tests on the other three
(``data.inverted=true``), newer work the other way round: their figures do not compare.
"""

import difflib
from dataclasses import dataclass
from pathlib import Path

from tex_lightning.data.readers.folder import own_folder
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.errors import UserError

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
        """Read the data set."""
        return read_kth_tips2b(own_folder(self.root, "kth_tips2b"))


def read_kth_tips2b(root: Path) -> Recordings:
    """Read the classes that have a folder.

    Raises:
        UserError: If there is none, a folder is no class, or photos are missing or too many.
    """
    if not root.is_dir():
        raise UserError(f"Folder {root} does not exist; data.root must hold one folder per class.")
    rows: list[Recording] = []
    for folder in sorted(path for path in root.iterdir() if path.is_dir()):
        if folder.name not in NUMBERS:
            near = difflib.get_close_matches(folder.name, NUMBERS, n=1)
            hint = f" (did you mean {near[0]}?)" if near else ""
            raise UserError(
                f"Folder {folder} is no class of KTH-TIPS-2b{hint}; they are {', '.join(NUMBERS)}."
            )
        for group, sample in enumerate(SAMPLES):
            rows += _read_sample(folder, sample, group)
    if not rows:
        raise UserError(
            f"Folder {root} holds none of the classes {', '.join(NUMBERS)}; check data.root."
        )
    return Recordings(tuple(rows))


def _read_sample(folder: Path, sample: str, group: int) -> list[Recording]:
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
