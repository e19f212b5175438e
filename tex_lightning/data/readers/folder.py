"""Readers of a user's own data: a folder for each class, or a CSV manifest.

The folder holds ``root/CLASS/haptic/*`` and ``root/CLASS/image/*``. Names of folders may be in any
case and in the plural (``Haptics``). ``root/CLASS/sound/*`` and the folders of senses of the user's
own, ``root/CLASS/NAME/*``, are read as well. A class without folders for its senses is read as it
lies, ``root/CLASS/*``: a file's suffix tells its sense.
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from tex_lightning.data.manifest import META, read_manifest
from tex_lightning.data.readers.file_names import flat_patterns, uncut
from tex_lightning.data.readers.layout import (
    BY_MANIFEST,
    advise,
    by_pattern,
    doubts,
    tables_of_labels,
)
from tex_lightning.data.readers.siblings import (
    check_sensor_folders,
    check_sensors,
    labels_apart,
    parts_apart,
    pieces,
    without_versions,
)
from tex_lightning.data.readers.vocabulary import (
    ASIDE,
    SPLITS,
    VERSIONS,
    is_about,
    is_called,
    is_sense,
    sense_of,
)
from tex_lightning.data.recordings import (
    MODALITIES,
    Recording,
    Recordings,
    is_hidden,
    modality_named,
)
from tex_lightning.errors import UserError, listed
from tex_lightning_runtime.files import expanded, natural_key
from tex_lightning_runtime.photos import IMAGE_SUFFIXES
from tex_lightning_runtime.tables import SUFFIXES
from tex_lightning_runtime.traces import TRACE_SUFFIXES, axis_files, stands_for_all

SYSTEMS = ("Thumbs.db", "desktop.ini")  # files that are nobody's
MAX_KINDS = 6
MAX_WHOLE = 3  # tables, in which all recordings may be, since so few are no data set
TO_SOUND = " Convert other sound to .flac or .wav, such as with ffmpeg."
TO_TABLE = " Save sheets of recordings as CSV."
TO_ARRAYS = " Write the samples of each recording to .csv or .npz, in Python."
TO_TEXT = " Rename what is a table of numbers in text to .csv."
TO_FILES = " Unpack archives and compressed files."
TO_PHOTO = " Convert the photos to .jpg or .png."
CURES = {
    **dict.fromkeys((".mp3", ".m4a", ".aac", ".ogg", ".opus", ".wma", ".mp4"), TO_SOUND),
    **dict.fromkeys((".aif", ".aiff", ".caf", ".au", ".amr", ".3gp", ".webm"), TO_SOUND),
    **dict.fromkeys((".xlsx", ".xls", ".ods", ".numbers"), TO_TABLE),
    **dict.fromkeys((".bag", ".db3", ".mcap"), TO_ARRAYS),
    **dict.fromkeys((".parquet", ".feather", ".pkl", ".pickle", ".tdms", ".c3d"), TO_ARRAYS),
    **dict.fromkeys((".edf", ".bdf", ".arrow", ".nc", ".bin"), TO_ARRAYS),
    **dict.fromkeys((".ts", ".arff", ".json", ".jsonl", ".cbor", ".xml"), TO_ARRAYS),
    **dict.fromkeys((".zip", ".tar", ".tgz", ".gz", ".bz2", ".xz", ".7z", ".rar"), TO_FILES),
    **dict.fromkeys((".dat", ".log", ".asc", ".prn"), TO_TEXT),
    **dict.fromkeys((".heic", ".heif", ".avif", ".gif", ".jp2", ".jxl"), TO_PHOTO),
    **dict.fromkeys((".raw", ".dng", ".cr2", ".cr3", ".nef", ".arw"), TO_PHOTO),
}  # of files that are not read, by suffix
TOO_DEEP = "Too deep and not read"  # begins a note
ABOUT = (".json", ".xml")  # which beside recordings are about these
BESIDE = {"haptic": TRACE_SUFFIXES, "image": IMAGE_SUFFIXES}  # of files in the folder of a class


@dataclass
class FolderReader:
    """One's own data.

    Attributes:
        root: Folder with a folder for each class.
    """

    root: str

    def read(self) -> Recordings:
        """Read the folder; a file's place in its class, in natural order, is its group."""
        return read_folder(expanded(self.root))


@dataclass
class ManifestReader:
    """A table.

    Attributes:
        manifest: CSV file.
    """

    manifest: str

    def read(self) -> Recordings:
        """Read the table."""
        return read_manifest(expanded(self.manifest))


def read_folder(root: str | Path) -> Recordings:
    """Read a folder with one folder per class; notes of the table list skipped files.

    Raises:
        UserError: If the folder is missing or holds no recordings.

    Example:
        >>> import tex_lightning as tl
        >>> table = tl.read_folder("DIR")
        >>> table.classes, len(table.of("haptic"))
        (['alpha', 'beta', 'gamma'], 30)
    """
    root = Path(root)
    if not root.is_dir():
        there = "is a file" if root.is_file() else "does not exist"
        raise UserError(f"Folder {root} {there}; give an existing folder in data.root.")
    rows: list[Recording] = []
    notes: list[str] = []
    others: list[Path] = []
    deeper: list[Path] = []
    for directory in _class_folders(root, notes):
        recordings = _read_class(directory, notes)
        deep = _deeper(directory, recordings)
        others += (path for path in _others(directory, recordings) if path not in deep)
        deeper += (path for path in deep if path.parent.name.casefold() not in META)
        if not deep and not recordings:
            notes.append(f"Class folder {directory} is skipped: it has no trace and no photo.")
        rows += recordings
    cures = _cures([path for path in others if not rows or path.suffix.lower() not in ABOUT])
    counted = [f"Of other kinds and not read: {count_kinds(others)}.{cures}"] if others else []
    recorded = _recorded(root)
    kinds = {row.path.suffix.lower() for row in rows}
    flat = [path for path in recorded if path.suffix.lower() in kinds]
    one = len({row.label for row in rows}) == 1  # which may be pictures of what is beside it
    if not rows or (one and len(flat) >= max(2, len(rows))):
        raise UserError(_nothing_in(root, others, counted))
    beside = [path for path in recorded if path.suffix.lower() not in SUFFIXES]
    if beside:
        notes.append(
            f"Beside the folders of classes and not read: {count_kinds(beside)}; move each into "
            "the folder of its class."
        )
    notes += pieces(rows)
    if deeper:
        told = advise(root, [*deeper, *(row.path for row in rows)])
        notes.append(f"{TOO_DEEP}: {count_kinds(deeper)}; {told}.")
    check_sensors(root, rows)
    table = without_versions(root, rows)
    notes += (*counted, *table.notes, *doubts(root, table.rows), *parts_apart(root, table.rows))
    return Recordings(table.rows, tuple(notes))


def _class_folders(root: Path, notes: list[str]) -> list[Path]:
    """Return the folders of classes, without those whose name says that they are none.

    Raises:
        UserError: If all of them are parts or versions of the data set.
    """
    folders = _folders(root)
    aside = [path for path in folders if path.name[0] == "_" or is_called(path.name, ASIDE)]
    instead = [path for path in folders if is_called(path.name, SPLITS | VERSIONS)]
    classes = [path for path in folders if path not in aside and path not in instead]
    senses = [path for path in classes if is_sense(path.name)]
    several = len({sense_of(path.name) for path in senses}) > 1
    most = several and len(senses) > len(classes) / 2
    others = [path for path in classes if path not in senses]
    alone = bool(senses) and _kinds(senses).isdisjoint(_kinds(others))  # beside tables
    if not others or most or alone:
        classes, instead = [], [*instead, *senses]
    check_sensor_folders(root, classes)
    few = sum(1 + len(_folders(folder)) for folder in classes) < 2
    if few and (len(instead) > 1 or any(is_sense(folder.name) for folder in instead)):
        paths = [path for each in instead for path in _all_recorded(each)]
        if paths:
            raise UserError(
                labels_apart(root, [path for folder in instead for path in _recorded(folder)])
                or f"Folder {root} has the folders {listed([folder.name for folder in instead])} "
                f"in the place of classes; {advise(root, paths)}."
            )
    if few:
        return [folder for folder in folders if folder.name.casefold() not in META]
    for folder in aside:
        if _all_recorded(folder):
            notes.append(
                f"{folder} is left out, as its name is none of a class; rename it if it is one."
            )
    return [folder for folder in folders if folder not in aside]


def _kinds(folders: Sequence[Path]) -> set[str]:
    return {path.suffix.lower() for folder in folders for path in _all_recorded(folder)}


def _all_recorded(folder: Path) -> list[Path]:
    return [*_recorded(folder), *_deeper(folder, ())]


def _recorded(folder: Path) -> list[Path]:
    return [path for suffixes in BESIDE.values() for path in _files(folder, suffixes)]


def _nothing_in(root: Path, others: Sequence[Path], counted: Sequence[str]) -> str:
    """Return the error for a folder without recordings: its files, and how to convert them."""
    flat = [path for path in _visible(root)
            if path.is_file() and path.name not in SYSTEMS]  # fmt: skip
    if apart := labels_apart(root, flat):
        return apart
    deep = [path for directory in _folders(root) for path in _deeper(directory, ())]
    recorded = _recorded(root)
    if len(deep) > len(recorded):
        return (
            f"Folder {root} has no recordings where they are looked for, in CLASS/haptic and the "
            f"like, but deeper: {count_kinds(deep)}; {advise(root, deep)}."
        )
    if named := next(iter(tables_of_labels(root)), None):
        return f"Folder {root} has no folder for each class, but {named.notes[-1]}."
    remedy = ""
    if 0 < len(recorded) <= MAX_WHOLE and {path.suffix.lower() for path in recorded} <= {*SUFFIXES}:
        remedy = (
            f"write the samples of each recording into a table of its own, {root}/LABEL/haptic/"
            "NUMBER.csv (docs/data.md, Recordings in one file)"
        )
    elif recorded:
        told = by_pattern(root, *(patterns := flat_patterns(recorded)))
        fits = f"{told}, or with a pattern that fits their names better"
        remedy = fits if patterns else BY_MANIFEST
    if remedy:
        said = (
            f"Folder {root} has no folder for each class: it holds {count_kinds(flat)}; {remedy}."
        )
        return " ".join([said, *counted])
    said = (
        f"Folder {root} holds no recordings; put traces in {root}/CLASS/haptic "
        f"({', '.join(TRACE_SUFFIXES)}), sounds in {root}/CLASS/sound (.wav, .flac) and photos in "
        f"{root}/CLASS/image (.jpg, .png, …).{'' if others else _cures(flat)}"
    )
    return " ".join([said, *counted])


def _cures(files: Sequence[Path]) -> str:
    """Return how files of other kinds become such as are read."""
    kinds = {re.sub(r"\.\d+$", ".dat", path.suffix.lower()) for path in files}  # 2003.10.22
    return "".join(dict.fromkeys(text for kind, text in CURES.items() if kind in kinds))


def _deeper(directory: Path, recordings: Sequence[Recording]) -> list[Path]:
    """Return the recordings below a class that are in none of the folders of its senses."""
    read = {file for row in recordings for file in axis_files(row.path)}
    seen = {directory, *(_folders(directory) if recordings else ())}
    suffixes = (*TRACE_SUFFIXES, *IMAGE_SUFFIXES)
    return [
        path
        for path in sorted(directory.rglob("*"))
        if path.parent not in seen and path not in read and path.suffix.lower() in suffixes
        and not is_about(path)
        and not is_hidden(path, directory) and path.is_file()
    ]  # fmt: skip


def count_kinds(files: Sequence[Path]) -> str:
    """Count files by their suffix, most frequent first, and name one of them.

    Example:
        >>> from pathlib import Path
        >>> from tex_lightning.data.readers.folder import count_kinds
        >>> count_kinds([Path("a/1.MP3"), Path("a/2.mp3"), Path("a/README")])
        '2 .mp3, 1 without suffix (such as a/1.MP3)'
    """
    kinds = Counter(file.suffix.lower() or "without suffix" for file in files)
    most = [f"{count} {kind}" for kind, count in kinds.most_common(MAX_KINDS)]
    more = ["others"] if len(kinds) > MAX_KINDS else []
    return f"{', '.join([*most, *more])} (such as {files[0]})"


def _others(directory: Path, recordings: Sequence[Recording]) -> Iterator[Path]:
    """Yield the files of a class that are no recordings; those beside its senses have a note."""
    read = {file for row in recordings for file in axis_files(row.path)}
    beside = tuple(chain.from_iterable(BESIDE.values()))
    for folder in (directory, *_folders(directory)):
        for path in _visible(folder):
            noted = folder == directory and path.suffix.lower() in beside and not is_about(path)
            if not (noted or path in read or path.name in SYSTEMS or path.is_dir()):
                yield path


def _read_class(directory: Path, notes: list[str]) -> list[Recording]:
    """Read one class, from folders of its senses if it has any; note what is passed over."""
    label, directory = directory.name, _unwrapped(directory)
    inner: dict[str, list[Path]] = {name: [] for name in MODALITIES}
    for folder in _folders(directory):
        sense = modality_named(folder.name.casefold())
        if sense.isidentifier():
            inner[sense] = inner.get(sense, []) + _files(folder, suffixes_of(sense))
    beside = {sense: _files(directory, suffixes) for sense, suffixes in BESIDE.items()}
    stray = [path.name for paths in beside.values() for path in paths]
    if not any(inner[name] for name in MODALITIES):
        inner |= beside
    elif stray:
        text = f"{directory} has folders for its senses, so {stray[0]} beside them is not read."
        notes.append(text)
    rows = []
    for sense, paths in inner.items():
        ordered = sorted(paths, key=lambda path: natural_key(path.name))
        names = uncut([path.stem for path in ordered])
        places = {name: n for n, name in enumerate(dict.fromkeys(names))}
        rows += [
            Recording(label, sense, path, f"{label}/{places[name]}")
            for path, name in zip(ordered, names, strict=True)
        ]
    return rows


def _unwrapped(directory: Path) -> Path:
    """Return the folder of a class, which may hold nothing but one of its name, as archives do."""
    inside = [path for path in _visible(directory) if path.name not in SYSTEMS]
    alone = len(inside) == 1 and inside[0].name.casefold() == directory.name.casefold()
    return _unwrapped(inside[0]) if alone and inside[0].is_dir() else directory


def suffixes_of(modality: str) -> tuple[str, ...]:
    """Return the suffixes of the files of a modality, in lower case; a user's may hold either."""
    both = {**BESIDE, "sound": TRACE_SUFFIXES}
    return both.get(modality, (*TRACE_SUFFIXES, *IMAGE_SUFFIXES))


def _folders(directory: Path) -> list[Path]:
    return [path for path in _visible(directory) if path.is_dir()]


def _visible(directory: Path) -> list[Path]:
    return [path for path in sorted(directory.glob("*")) if not is_hidden(path, directory)]


def _files(directory: Path, suffixes: tuple[str, ...]) -> list[Path]:
    return [
        path
        for path in _visible(directory)
        if path.suffix.lower() in suffixes
        and not is_about(path)
        and not path.is_dir()
        and stands_for_all(path)
    ]
