"""The table of recordings, which readers make and all other parts use.

A recording may be a part of its file, given as two fractions from 0 to 1 of the length of a signal
or of the width of a photo. Parts that do not overlap have no sample or pixel in common.
"""

import math
import re
import unicodedata
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tex_lightning.errors import UserError, listed, shorten
from tex_lightning_runtime.files import natural_key

Part = tuple[float, float]
WHOLE: Part = (0.0, 1.0)


def write_part(part: Part) -> str:
    """Return the part as text, such as ``0-0.5``, exactly."""
    return "-".join(np.format_float_positional(border, trim="-") for border in part)


def read_part(text: str) -> Part:
    """Return the part that :func:`write_part` wrote.

    Raises:
        ValueError: If it is none.
    """
    begin, end = map(float, text.split("-"))
    if not 0 <= begin < end <= 1:
        raise ValueError("it does not rise from 0 to 1")
    return begin, end


def overlap(one: Part | None, other: Part | None) -> bool:
    """Return whether two parts of one file share anything; None is all of it."""
    (begin, end), (start, stop) = one or WHOLE, other or WHOLE
    return begin < stop and start < end


def cut_part(array: npt.NDArray[Any], part: Part | None, path: Path) -> npt.NDArray[Any]:
    """Cut the part out of a signal (axes, samples) or a photo (height, width, 3).

    Raises:
        UserError: If nothing is in it.
    """
    if part is None:
        return array
    begin, end = (round(border * array.shape[1]) for border in part)
    if begin == end:
        raise UserError(
            f"Part {write_part(part)} of {path} is empty, as the file has only {array.shape[1]} "
            "samples or columns; give a larger part."
        )
    return array[:, begin:end]


MODALITIES = ("haptic", "image", "sound")  # that the package brings; others are a user's
NAMES = {"haptic": "trace", "image": "photo"}  # of one recording, where that has another name
HIDDEN = (  # begin names of what is nobody's; office programs and systems write the others
    ".", "~$", "$RECYCLE", "System Volume", "@eaDir", "lost+found",
)  # fmt: skip
COPY = re.compile(r"(?: (?:copy|kopie|copia|old|new|backup|\(\d+\)))+$")  # of a folder
Conditions = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Recording:
    """One recording of a surface: a file, or a part of one.

    Attributes:
        label: Class name.
        modality: ``haptic`` for an acceleration trace, ``image`` for a photo, ``sound``, or a
            custom name.
        path: The file.
        group: Recordings with the same group, of whatever class, are never divided between training
            and test: any text, such as a session, a specimen or a person, or a whole number.
        sampling_rate: Rate of a signal in Hz if the reader has it, else None (a WAV file states its
            rate; other formats have the configured rate).
        conditions: Conditions of the recording, each a pair of name and value, such as
            ``(("speed", "60"),)``; every further column of a manifest is one.
        part: The part of the file, as fractions of the length of a signal or of the width of a
            photo (see above); None is the whole file.
        fold: Fold in the division of the whole table, from 0; None leaves that to :mod:`.folds`.

    Example:
        >>> import tex_lightning as tl
        >>> from pathlib import Path
        >>> tl.Recording("oak", "haptic", Path("oak_3.wav"), group=3).label
        'oak'
    """

    label: str
    modality: str
    path: Path
    group: int | str
    sampling_rate: float | None = None
    conditions: Conditions = ()
    part: Part | None = None
    fold: int | None = field(default=None, compare=False)

    @property
    def group_key(self) -> str:
        """Identity of the group among those of all classes and modalities."""
        return str(self.group)

    @property
    def source(self) -> str:
        """Unique name of the file and its part, for messages and tables."""
        return f"{self.path}#{write_part(self.part)}" if self.part else str(self.path)


@dataclass(frozen=True)
class Recordings:
    """An immutable table of recordings.

    Attributes:
        rows: The recordings.
        notes: Notes on files that were skipped or divided on reading; comparisons of tables
            ignore them.

    Example:
        >>> import tex_lightning as tl
        >>> from pathlib import Path
        >>> files = [Path("oak_1.wav"), Path("oak_2.wav")]
        >>> rows = tuple(tl.Recording("oak", "haptic", file, at) for at, file in enumerate(files))
        >>> table = tl.Recordings(rows)
        >>> len(table.of("haptic")), len(table.of("image")), table.classes
        (2, 0, ['oak'])
    """

    rows: tuple[Recording, ...]
    notes: tuple[str, ...] = field(default=(), compare=False)

    def __iter__(self) -> Iterator[Recording]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def classes(self) -> list[str]:
        """Class names in natural order; the position of a name is its index."""
        return sorted({row.label for row in self.rows}, key=natural_key)

    def of(self, *modalities: str) -> "Recordings":
        """Return the rows of some modalities."""
        return self._where(lambda row: row.modality in modalities)

    def in_classes(self, classes: Iterable[str]) -> "Recordings":
        """Return the rows whose label is one of ``classes``."""
        names = set(classes)
        return self._where(lambda row: row.label in names)

    def without(self, rows: Iterable[Recording]) -> "Recordings":
        """Return the other rows; no group number changes."""
        left_out = set(rows)
        return self._where(lambda row: row not in left_out)

    def _where(self, keep: Callable[[Recording], bool]) -> "Recordings":
        return replace(self, rows=tuple(row for row in self.rows if keep(row)))


def normal_form(name: str) -> str:
    """Return the normal form of a name: composed accents (Unicode NFC), no outer blanks.

    Some systems write an accent as a separate character, and spreadsheets keep trailing blanks.
    """
    return unicodedata.normalize("NFC", name).strip()


def with_one_spelling(recordings: Recordings) -> Recordings:
    """Return the table with one spelling of each class; notes name what had several, or is near."""
    spellings: dict[str, set[str]] = defaultdict(set)
    rows = []
    for row in recordings:
        spellings[label := normal_form(row.label)].add(row.label)
        group = normal_form(row.group) if isinstance(row.group, str) else row.group
        rows.append(replace(row, label=label, group=group))
    notes = [
        f"{' and '.join(map(ascii, sorted(several)))} look alike and are one class, {label}."
        for label, several in spellings.items()
        if len(several) > 1
    ]
    near: dict[str, set[str]] = defaultdict(set)
    for label in spellings:
        plain = COPY.sub("", re.sub(r"[\s_-]+", " ", label.casefold())).removesuffix("s")
        near[plain].add(label)
    notes += [
        f"{listed(sorted(several))} are classes of their own, and differ in capitals, separators, "
        "a plural or a word such as copy alone; give them one name if they are one."
        for several in near.values()
        if len(several) > 1
    ]
    return replace(recordings, rows=tuple(rows), notes=(*recordings.notes, *notes))


def class_indices(labels: Iterable[str], classes: Sequence[str]) -> list[int]:
    """Return the index of each label among the classes."""
    index = {name: number for number, name in enumerate(classes)}
    return [index[label] for label in labels]


def modality_named(name: str) -> str:
    """Return the modality of the package that a name means (``Haptic data``), or the name."""
    plain = re.sub(r"\s+(?:data|files|recordings)$", "", name.strip().casefold())
    known = plain.removesuffix("s")
    return known if known in MODALITIES else name


def is_hidden(path: Path, root: Path) -> bool:
    """Return whether a path, or a folder between it and the root, is nobody's."""
    return any(part.startswith(HIDDEN) for part in path.relative_to(root).parts)


def check_is_list(name: str, given: object) -> None:
    """Reject one path where a list of recordings is meant: its letters would be taken for paths.

    Raises:
        UserError: If it is one, naming it.
    """
    if isinstance(given, str | Path):
        raise UserError(f"{name} is {shorten(given)}; give a list, of one path if there is one.")


def singular(modality: str) -> str:
    """Return the name of one recording of a modality."""
    return NAMES.get(modality, f"{modality} recording")


def plural(modality: str) -> str:
    """Return the name of several recordings of a modality."""
    return f"{singular(modality)}s"


def check_row(row: Any, where: str) -> None:  # noqa: ANN401
    """Reject a row that violates :class:`Recording`; the message begins with ``where``.

    Raises:
        UserError: Naming the field and what it should be.
    """
    if not isinstance(row, Recording):
        raise UserError(f"{where} is {type(row).__name__}; make it a tex_lightning.Recording.")
    for name, (fits, wanted) in FIELDS.items():
        if not fits(value := getattr(row, name)):
            raise UserError(f"{where} has {name} {shorten(repr(value))}; give {wanted}.")


def _is_pair(given: Any, kind: type) -> bool:  # noqa: ANN401
    of_two = isinstance(given, tuple) and len(given) == 2
    return of_two and all(isinstance(item, kind) for item in given)


FIELDS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "label": (lambda x: isinstance(x, str) and x.strip() != "", "a name"),
    "modality": (
        lambda x: isinstance(x, str) and x.isidentifier(), "one word, such as haptic or image"
    ),
    "path": (lambda x: isinstance(x, Path), "a pathlib.Path"),
    "group": (
        lambda x: x.strip() > "" if isinstance(x, str) else isinstance(x, Integral) and int(x) >= 0,
        "a text, such as a session, or a whole number from 0",
    ),
    "sampling_rate": (
        lambda x: x is None or (isinstance(x, Real) and 0 < float(x) < math.inf),
        "a number of Hz, or none",
    ),
    "conditions": (
        lambda x: isinstance(x, tuple) and all(_is_pair(item, str) for item in x),
        'pairs of texts, such as (("speed", "60"),)',
    ),
    "part": (
        lambda x: x is None or (_is_pair(x, Real) and 0 <= x[0] < x[1] <= 1),
        "two rising fractions, such as 0-0.5, or none",
    ),
    "fold": (
        lambda x: x is None or (isinstance(x, Integral) and int(x) >= 0),
        "a whole number from 0, or none",
    ),
}  # fmt: skip


def with_plain_numbers(row: Recording) -> Recording:
    """Return a checked row with Python's numbers in place of NumPy's, which JSON does not know."""
    group, rate, part, fold = row.group, row.sampling_rate, row.part, row.fold
    return replace(
        row,
        group=group if isinstance(group, str) else int(group),
        sampling_rate=None if rate is None else float(rate),
        part=None if part is None else (float(part[0]), float(part[1])),
        fold=None if fold is None else int(fold),
    )


def check_distinct(what: str, rows: Iterable[Recording]) -> None:
    """Reject duplicates: in two groups a file would be trained and tested on."""
    listed: dict[Path, list[tuple[int, Part | None]]] = defaultdict(list)
    for number, row in enumerate(rows, start=1):
        for earlier, part in listed[row.path]:
            if overlap(part, row.part):
                raise UserError(
                    f"{what} lists {row.source} in record {earlier} and in record {number}; keep "
                    "one of them, or give each its part of it."
                )
        listed[row.path].append((number, row.part))
