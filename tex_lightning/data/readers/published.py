"""The reader of published data sets: a regular expression finds class and group in a path.

Expression, folders and rate of a set stand in ``conf/data/NAME.yaml``. They rest on these facts:

- **TUM** (LMT-69): 10 kHz, already reduced to one axis by DFT321. Photos ``IMG_*.JPG`` carry no
  class; their order does: ten per class, in the order of the class names.
- **LMT-108**: ten recordings per class and half, 10 kHz, an axis a file, which decoding joins.
- **Cluster** (2024): a machine moves a rubber fingertip over 118 surfaces, 160 strokes each
  (degrees, mm/s, mN), ``accel`` (g) and ``force`` (N) at nominally 6 kHz with time stamps,
  ``audio`` 44.1 kHz. The files were not seen.
- **Kylberg** v1.0: 28 classes of 160 grey patches of four surfaces a to d, the rotated set with
  ``-r30`` and so on behind the number. By ``patch`` every fold has patches of all surfaces, as
  random divisions have; by ``surface`` no neighbour of a tested patch was trained on.
- **KTH-TIPS-2b**: 11 classes of 4 samples, 108 photos of a sample. The paper trains on one sample
  and tests on three (``data.inverted=true``).
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tex_lightning.config.keys import choice
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.errors import UserError
from tex_lightning_runtime.files import expanded, natural_key
from tex_lightning_runtime.photos import IMAGE_SUFFIXES
from tex_lightning_runtime.traces import TRACE_SUFFIXES, stands_for_all


@dataclass(kw_only=True)
class PatternReader:
    """Reader of a data set whose files tell their class and group by their paths.

    Attributes:
        root: Folder of the data set.
        folders: Folder of each modality, below ``root``; None leaves it out.
        pattern: Regular expression of a path below such a folder, in any case, with the groups
            ``label``, those of ``groups`` and one for each condition.
        example: Such a path, for messages.
        group_by: Which part of the path makes a group, and so a fold: the values count in order.
            A value is one group in each class, and a condition is one in all of them.
        groups: What ``group_by`` may be, and how many groups that usually makes.
        folds: Number of folds, which the values are dealt to in turn; None leaves out the folds.
        conditions: Parts of the path that are conditions of the recording.
        rate: Rate of the ``.txt`` files in Hz.
        split: Half that is read, where the path has a group ``split``: ``training``, ``testing``.
        page: Address where the data set is to be had, for messages; None if it is the user's own.

    Raises:
        UserError: If ``group_by`` is unknown.
    """

    root: str
    folders: Mapping[str, str | None]
    pattern: str
    example: str
    group_by: str
    groups: Mapping[str, int]
    folds: int | None = None
    conditions: Sequence[str] = ()
    rate: float | None = None
    page: str | None = None
    split: str = "training"

    def __post_init__(self) -> None:
        self.folder = expanded(self.root)
        for complaint in choice("data.group_by", self.group_by, tuple(self.groups)):
            raise UserError(f"{complaint}.")

    def read(self) -> Recordings:
        """Read all modalities; the groups count the values of ``group_by`` that are there.

        Raises:
            UserError: If there are no recordings.
        """
        notes: list[str] = []
        matches = [
            (modality, path, match)
            for modality, name in self.folders.items()
            if name is not None
            for path, match in self._matches(self.folder / name, notes)
        ]
        if not matches:
            source = f", or get the data set from {self.page}" if self.page else ""
            raise UserError(
                f"Folder {self.folder} holds no {self.example}; check data.root{source}."
            )
        values = sorted({match[self.group_by] for _, _, match in matches}, key=natural_key)
        rows = [
            Recording(
                match["label"],
                modality,
                path,
                self._group(match["label"], number := values.index(match[self.group_by])),
                self.rate if path.suffix.lower() == ".txt" else None,
                tuple((name, match[name]) for name in self.conditions),
                fold=self._fold(number),
            )
            for modality, path, match in matches
        ]
        return Recordings(tuple(rows), tuple(notes))

    def _group(self, label: str, number: int) -> str:
        return f"{self.group_by if self.group_by in self.conditions else label}/{number}"

    def _fold(self, number: int) -> int | None:
        return None if self.folds is None else number % self.folds

    def _matches(self, folder: Path, notes: list[str]) -> Iterator[tuple[Path, re.Match[str]]]:
        """Yield the recordings below a folder in natural order; note what is not read."""
        matches: dict[Path, re.Match[str]] = {}
        others: list[Path] = []
        for path in sorted(folder.rglob("[!.]*"), key=lambda path: natural_key(str(path))):
            if path.suffix.lower() not in (*TRACE_SUFFIXES, *IMAGE_SUFFIXES):
                continue
            name = path.relative_to(folder).as_posix()
            if (match := re.fullmatch(self.pattern, name, re.IGNORECASE)) is None:
                others.append(path)
            elif self.split.startswith(match.groupdict().get("split", "")) and stands_for_all(path):
                matches[path] = match
        folders = {path.parent for path in matches}
        if strays := [path for path in others if path.parent in folders]:
            count = f" and {len(strays) - 1} more" if len(strays) > 1 else ""
            notes.append(f"Not called {self.example} or the like, so not read: {strays[0]}{count}.")
        yield from matches.items()


@dataclass(kw_only=True)
class TumReader(PatternReader):
    """The TUM haptic texture database, whose photos tell their classes by their order."""

    per_class = 10  # photos

    def read(self) -> Recordings:
        """Read traces and photos of the training part of the database.

        Raises:
            UserError: If there are no traces, or another number of photos than ten per class.
        """
        traces = super().read()
        photos = self._photos(self.folder / "Training", traces.classes)
        return Recordings((*traces.rows, *photos), traces.notes)

    def _photos(self, training: Path, labels: list[str]) -> tuple[Recording, ...]:
        """Read photos by sorted order; none at all is allowed, since HapticNet needs none."""
        files = sorted(training.rglob("[!.]*"), key=lambda path: natural_key(path.name))
        photos = [
            path
            for path in files
            if path.suffix.lower() in (".jpg", ".jpeg") and path.parent.name != "ImageMagnified"
        ]
        if photos and len(photos) != self.per_class * len(labels):
            raise UserError(
                f"Folder {training} holds {len(photos)} photos, but {len(labels)} classes need "
                f"{self.per_class} each; correct that, or list all files for data=manifest."
            )
        places = [divmod(number, self.per_class) for number in range(len(photos))]
        return tuple(
            Recording(
                label := labels[kind], "image", path, self._group(label, at), fold=self._fold(at)
            )
            for (kind, at), path in zip(places, photos, strict=True)
        )
