"""Files beside each other that belong together: sensors, versions, recordings and their labels."""

import re
from collections import defaultdict
from collections.abc import Sequence
from itertools import chain
from pathlib import Path, PurePath, PurePosixPath

from tex_lightning.data.manifest import META
from tex_lightning.data.readers.file_names import PIECE, shared_part
from tex_lightning.data.readers.layout import (
    advise,
    by_pattern,
    classes_in_names,
    sense_token,
)
from tex_lightning.data.readers.vocabulary import (
    PLAIN,
    SPLITS,
    VERSIONS,
    is_called,
    words,
)
from tex_lightning.data.recordings import Recording, Recordings, plural
from tex_lightning.errors import UserError, inflected, listed
from tex_lightning_runtime.files import is_file
from tex_lightning_runtime.tables import SUFFIXES

SENSOR = re.compile(
    r"(?<![a-z])(?:acc|accel[a-z]*|gyro[a-z]*|mag|magnet[a-z]*|gravity|orientation|force|torque|pressure"
    r"|temp|temperature|audio|sound|mic|microphone|haptic|tactile|vibration|rgb|depth|mask|imu|pro|ft"
    r"|gyr|gps|baro|emg|ecg|eeg|ppg|bvp|eda|hr)(?![a-z])",
    re.IGNORECASE,
)  # in the names of files beside each other
NUMBERED = re.compile(r"(?<![a-z])(?:ch|chan|channel|axis|sensor|mic|taxel)\d+", re.IGNORECASE)
NO_FOLDS = (
    "which folds do not follow; give these in a column split of a manifest, and test by "
    "data.test_where (docs/evaluate.md)"
)
LONGEST = 1 << 12  # letters of the first line of a list
MAX_SHARED = 5  # parts of names that are told
SAME = {".jpeg": ".jpg", ".jfif": ".jpg", ".tiff": ".tif", **dict.fromkeys(SUFFIXES, ".csv")}


def check_sensor_folders(root: Path, folders: Sequence[Path]) -> None:
    """Reject folders of classes that are all called as sensors.

    Raises:
        UserError: Naming them.
    """
    if len(folders) > 1 and all(SENSOR.fullmatch(folder.name) for folder in folders):
        raise UserError(
            f"Folder {root} has the folders {listed([folder.name for folder in folders])} of "
            f"sensors in the place of classes; give one of them, such as data.root={folders[0]}, "
            "write the columns of one recording into one file, or, if they are classes, give "
            "these in a manifest (docs/data.md, Manifest)."
        )


def check_sensors(root: Path, rows: Sequence[Recording]) -> None:
    """Reject files of several sensors of one recording, which would be recordings of their own.

    Raises:
        UserError: Naming two whose names differ in words such as ``acc`` and ``gyro``, or, as
            others do, in the number behind one such as ``ch``.
    """
    named, numbered = _beside(rows, SENSOR), _beside(rows, NUMBERED)
    for word, first, other in named or (numbered if len(numbered) > 1 else ()):
        remedy = "write the columns of one recording into one file"
        if first.suffix != other.suffix:
            remedy = "move what is no haptic recording into a folder of its sense, such as sound"
        same = [row.path for row in rows if word in row.path.stem]
        raise UserError(
            f"{first} and {other.name} are of two sensors by their names; {remedy}, or choose a "
            f"sensor: {advise(root, same, f'*{word}*')}."
        )


def _beside(rows: Sequence[Recording], sensor: re.Pattern[str]) -> list[tuple[str, Path, Path]]:
    """Return files, two each, whose names differ in a word that is found alone, and this word."""
    found: dict[object, dict[str, Path]] = defaultdict(dict)
    for row in rows:
        if match := sensor.search(row.path.stem):
            rest = row.path.with_name(sensor.sub("*", row.path.stem))
            found[row.modality, row.label, row.conditions, rest].setdefault(match[0], row.path)
    several = ([*same.items()][:2] for same in found.values() if len(same) > 1)
    return [(word, first, other) for (word, first), (_, other) in several]


def without_versions(root: Path, rows: Sequence[Recording]) -> Recordings:
    """Leave out further versions of recordings, such as ``1_filtered.csv`` beside ``1_raw.csv``.

    Returns:
        Of each recording the version without such a word, or else the raw one; a note names others.
    """
    versions: dict[object, dict[frozenset[str], list[Recording]]] = defaultdict(dict)
    values = defaultdict[str, list[str]](list)
    for name, value in chain.from_iterable(row.conditions for row in rows):
        values[name].append(value)
    told = {name for name in values if all(is_called(each, VERSIONS) for each in values[name])}
    for row in rows:
        named = words(row.path.relative_to(root).with_suffix("").as_posix())
        said = frozenset(named) & VERSIONS - {*words(row.label)}
        plain = tuple(
            word for word in named if word not in said and not (said and word in ("of", "von"))
        )
        named_by = tuple(pair for pair in row.conditions if pair[0] in told)
        versions[row.modality, named_by, plain].setdefault(said, []).append(row)
    left: set[Recording] = set()
    for same in versions.values():
        kept = min(same, key=lambda said: (bool(said), not said & PLAIN, sorted(said)))
        left.update(row for said, several in same.items() if said != kept for row in several)
    table = Recordings(tuple(row for row in rows if row not in left))
    if not left:
        return table
    paths = [row.path for row in rows if row in left]
    stem, name = paths[0].stem, "*"
    for word in sorted(VERSIONS & {*words(stem)}):  # else a folder has it
        at = stem.casefold().index(word)
        name = f"*{stem[at : at + len(word)]}*"
    files = inflected(
        len(left),
        "file is left out as a version of a recording beside it by its name",
        "files are left out as versions of recordings beside them by their names",
    )
    instead = f"to take them instead, {advise(root, paths, name)}"
    note = f"{files}, such as {paths[0]}; {instead}."
    return Recordings(table.rows, (note,))


def pieces(rows: Sequence[Recording]) -> list[str]:
    """Say which files are in one group as pieces of one recording, and which are all of a class."""
    cut = [row for row in rows if PIECE.search(row.path.stem)]
    groups = {(row.modality, row.group) for row in cut}
    notes = [
        f"{len(cut)} files are pieces of {len(groups)} recordings by their names, such as "
        f"{row.path}, and those of one recording are a group."
        for row in cut[:1]
        if len(groups) < len(cut)
    ]
    whole: dict[tuple[str, str], list[Path]] = defaultdict(list)
    for row in rows:
        whole[row.label, row.modality].append(row.path)
    alone = {
        label
        for (label, _), paths in whole.items()
        if len(paths) > 1 == len({PIECE.sub("", path.stem) for path in paths})
        and all(PIECE.search(path.stem) for path in paths)
    }
    if alone:
        notes.append(
            f"All files of {listed(sorted(alone))} are pieces of one recording by their names, and "
            "are groups of their own: a test on one that trains on the others tells little."
        )
    return notes


def parts_apart(root: Path, rows: Sequence[Recording]) -> list[str]:
    """Say which files may be of one person, recording or test, or tell a class by their kind."""
    return [*made_together(root, rows), *_splits(rows), *split_lists(root, rows), *_kinds(rows)]


def made_together(root: Path, rows: Sequence[Recording], above: str = "") -> list[str]:
    """Say which part several names of a class share: a person, a session or a recording.

    Args:
        root: Folder of the data set.
        rows: The recordings.
        above: Pattern of the folders above them, by which they were read; empty if by classes.
    """
    for modality in dict.fromkeys(row.modality for row in rows):
        alike = [row for row in rows if row.modality == modality]
        labels = [row.label for row in alike]
        found = shared_part([row.path for row in alike], labels) if len({*labels}) > 1 else None
        if found and (above or not _told_as_classes(found[0], alike)):
            values, first, name = found
            told = listed([*values[:MAX_SHARED], *["…"][: len(values) - MAX_SHARED]])
            inside = map(sense_token, alike[first].path.relative_to(root).parts[1:-1])
            folders = above or "".join(f"{part}/" for part in ("{label}", *inside))
            return [
                f"{alike[first].path} and others share {told} in their names, and are in groups of "
                "their own; if one such part is one person, session or recording, "
                f"{by_pattern(root, ((), folders + name))}."
            ]
    return []


def _told_as_classes(values: Sequence[str], rows: Sequence[Recording]) -> bool:
    """Return whether people, who are folders, are told to be no classes, but what is shared is."""
    if not all(re.search(r"\d", label) for label in {row.label for row in rows}):
        return False
    return {*values} in ({*classes} for classes, _ in classes_in_names(rows))


def _splits(rows: Sequence[Recording]) -> list[str]:
    """Say that the names of files have ``train`` and ``test``, where all have one."""
    said = [SPLITS & {*words(row.path.stem)} for row in rows]
    found = sorted(set().union(*said))
    if not all(said) or len(found) < 2:
        return []
    return [f"The names of files have {', '.join(found)}, {NO_FOLDS}."]


def split_lists(root: Path, rows: Sequence[Recording]) -> list[str]:
    """Say that lists such as ``testing_list.txt`` name recordings, by class and file."""
    known = {_short(row.path) for row in rows}
    inside = [path for folder in ("", *META) for path in sorted((root / folder).glob("*.txt"))]
    found = [path for path in inside if SPLITS & {*words(path.stem)} and _lists(path, known)]
    more = f" and {inflected(len(found) - 1, 'more list', 'more lists')} name"
    return [
        f"{path.relative_to(root)}{more if found[1:] else ' names'} recordings to train or test "
        f"on, {NO_FOLDS}."
        for path in found[:1]
    ]


def _lists(path: Path, known: set[str]) -> bool:
    """Return whether the first line of a text names a recording, with its suffix or not."""
    if not is_file(path):
        return False
    with path.open(errors="replace") as stream:
        first = stream.readline(LONGEST).split()
    return bool(first) and _short(PurePosixPath(first[0])) in known


def _short(path: PurePath) -> str:
    return f"{path.parent.name}/{path.stem}"


def _kinds(rows: Sequence[Recording]) -> list[str]:
    """Say that classes are files of kinds of their own, ``.jpg`` and ``.png``, which differ."""
    found: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for row in rows:
        kind = row.path.suffix.lower()
        found[row.modality][SAME.get(kind, kind)].add(row.label)
    for modality, kinds in found.items():
        classes = [sorted(labels) for labels in kinds.values()]
        if len(kinds) > 1 and sum(map(len, classes)) == len({*chain.from_iterable(classes)}):
            (one, first), (other, second), *_ = kinds.items()
            return [
                f"The {plural(modality)} of {listed(sorted(first))} are {one} and those of "
                f"{listed(sorted(second))} {other}, which may tell the class; convert all to one."
            ]
    return []


def labels_apart(root: Path, files: Sequence[Path]) -> str:
    """Return the error for recordings in one file and their labels in another; empty if not so."""
    known = {str(path).casefold(): path for path in files}
    for path in files:
        kind = path.name[1:].casefold()  # and x.csv beside y.csv are axes
        labels = known.get(str(path.with_name(f"y{kind}")).casefold())
        if path.name[0] in "xX" and labels and re.fullmatch(r"\.npy|_?(train|test)\.\w+", kind):
            return (
                f"Folder {root} holds recordings and labels apart, {path.relative_to(root)} and "
                f"{labels.name}; write each {'row of X' if kind == '.npy' else 'recording'} into "
                f"{root}/LABEL/haptic/NUMBER{path.suffix} (docs/data.md, Recordings in one file)."
            )
    return ""
