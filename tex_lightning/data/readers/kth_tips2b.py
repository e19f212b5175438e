"""Reader of KTH-TIPS-2b: 11 classes, 4 samples each, 108 photos of a sample.

Files are ``{class}/sample_{a,b,c,d}/{number}{a,b,c,d}-scale_{2..10}_im_{1..12}_col.png``, where the
number belongs to the class. A sample is another piece of the material; it is the group, so that
four folds are the four samples. The paper trains on one sample and tests on the other three
(``data.inverted=true``), newer work the other way round: their figures do not compare.
"""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

from tex_lightning.config.check_ranges import nearest
from tex_lightning.data.readers.folder import class_folders
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
