"""What folders and names above and beside recordings mean, where they are not those of classes.

Folders of people, sessions or days above or below the classes, parts such as ``train``, versions
such as ``raw`` and ``filtered``, a table of labels: what is in doubt is told, with the command that
reads it.
"""

import re
import shlex
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

from tex_lightning.core.files import resolved
from tex_lightning.data.manifest import META, names_recordings
from tex_lightning.data.recordings import (
    MODALITIES,
    Recording,
    Recordings,
    is_hidden,
    modality_named,
)
from tex_lightning.errors import inflected, listed
from tex_lightning_runtime.files import expanded

SPLITS = {"train", "training", "val", "valid", "validation", "test", "testing", "eval", "fold"}
ASIDE = SPLITS | {  # folders that are no classes, by their names
    "unlabelled", "unlabeled", "results", "result", "output", "outputs", "predictions", "figures",
    "plots", "code", "src", "scripts", "notebooks", "models", "checkpoints", "logs", "docs",
    "backup", "backups", "calibration", "calib", "pycache", "macosx", "old", "tmp",
    "temp", "trash", "archive", "archived", "excluded", "discarded", "rejected", "unused",
    *META,
}  # fmt: skip
PLAIN = {"raw", "original", "originals", "orig", "unfiltered"}
VERSIONS = PLAIN | {  # of one recording
    "filtered", "filt", "lowpass", "highpass", "bandpass", "smoothed", "denoised", "cleaned",
    "processed", "preprocessed", "normalized", "normalised", "resampled", "downsampled", "cropped",
    "trimmed", "augmented", "flip", "flipped", "mirrored", "rotated", "hdr", "mask", "masks",
    "resized", "thumb", "thumbs", "thumbnail", "edited", "copy", "kopie", "bak", "fft", "psd",
    "spectrum", "spectrogram", "features", "labels", "annotations", "timestamps", "meta",
    "metadata", "info", "notes",
}  # fmt: skip
FILLERS = {"data", "dataset", "set", "recordings", "samples", "files", "folder", "of"}
READ_ME = {  # text and tables beside recordings, of any suffix
    "readme", "read_me", "readme_first", "license", "metadata", "index", "labels", "manifest",
    "info", "settings", "config", "parameters", "notes", "note", "calibration", "calib",
    "annotation", "annotations", "comments", "description", "protocol", "summary",
}  # fmt: skip
SEPARATORS = "_- "
MEANT = {  # names of folders and of modalities that are none of the package's
    **dict.fromkeys(("acc", "accel", "acceleration", "accelerometer", "vibration", "tactile",
                     "touch", "trace", "signal", "movement"), "haptic"),
    **dict.fromkeys(("photo", "picture", "img", "visual", "camera", "rgb"), "image"),
    **dict.fromkeys(("audio", "mic", "microphone"), "sound"),
}  # fmt: skip


def by_pattern(root: Path, *patterns: tuple[Sequence[str], str]) -> str:
    """Say how a manifest is made by one of several patterns, each with the classes that it gives.

    Args:
        root: The folder.
        patterns: The classes, empty where they are not in doubt, and the pattern.
    """
    folder = shlex.quote(f"data.root={root}")
    told = [
        f"{f'if {listed(classes)} are the classes, ' if classes else ''}run task=manifest {folder} "
        f"pattern='{pattern}'"
        for classes, pattern in patterns
    ]
    return f"{'; '.join(told)}, and train with data=manifest"


def advise(root: Path, paths: Sequence[Path], name: str = "*") -> str:
    """Say how recordings are read whose folders are not those of classes and senses alone.

    Args:
        root: Folder of the data set.
        paths: Some of the recordings.
        name: Pattern of their names.
    """
    if named := _named_in(root, paths):
        return named
    folders = {path: path.relative_to(root).parts[:-1] for path in paths}
    aside = ASIDE - SPLITS
    kept = {p: f for p, f in folders.items() if not any(is_called(part, aside) for part in f)}
    plain = [[part for part in parts if not is_sense(part)] for parts in (kept or folders).values()]
    depth = max(map(len, plain))
    levels = [[*dict.fromkeys(each[n] for each in plain if len(each) > n)] for n in range(depth)]
    deepest = next(p for p, each in zip(kept or folders, plain, strict=True) if len(each) == depth)
    suffixes = {path.suffix for path in paths}
    ending = f"{name}{deepest.suffix if len(suffixes) == 1 else '' if name == '*' else '*'}"
    patterns = []
    for at in _levels_of_classes(levels):
        tokens = iter(_tokens(levels, at))
        parts = [_sense_token(p) if is_sense(p) else next(tokens) for p in folders[deepest]]
        end = (
            ending if at is not None else f"{{label}}_{{group}}{ending.removeprefix(name) or '.*'}"
        )
        patterns.append((levels[at] if at is not None else [], "/".join([*parts, end])))
    return by_pattern(root, *(patterns if len(patterns) > 1 else [((), patterns[0][1])]))


def hint(root: str | None, rows: Iterable[Recording]) -> list[str]:
    """Say how recordings in folders of no sense may be read, if there are any in a folder."""
    if root is None:
        return []
    folder = expanded(root)
    rows = [row for row in rows if row.path.is_relative_to(folder)]
    if rename({row.modality for row in rows}):  # which its callers tell
        return []
    paths = [row.path for row in rows]
    deep = [
        p for p in paths if len(parts := p.relative_to(folder).parts) > 2
        and (is_sense(parts[0]) or sum(not is_sense(part) for part in parts) > 2)
    ]  # fmt: skip
    text = advise(folder, deep) if deep else _named_in(folder, paths) if paths else ""
    return [f"{text[:1].upper()}{text[1:]}."] if text else []


def rename(modalities: Iterable[str]) -> str:
    """Say how modalities are called whose names mean others; empty if there are none."""
    told = [f"{name} to {known}" for name in sorted(modalities) if (known := _meant(name))]
    return f" Rename {listed(told)} (folders, or the column modality)." if told else ""


def _named_in(root: Path, paths: Sequence[Path]) -> str:
    """Say which table in a folder names some of the recordings and their classes; empty if none."""
    known = {resolved(path) for path in paths}
    tables = (table for table in tables_of_labels(root) if {row.path for row in table} & known)
    return next((table.notes[-1] for table in tables), "")


def _levels_of_classes(levels: Sequence[Sequence[str]]) -> list[int | None]:
    """Return the levels of folders that may be the classes; None where only names of files may.

    Names that differ in numbers alone are people, sessions or days rather than classes.
    """
    free = [n for n, names in enumerate(levels) if not _are(names, SPLITS) | _are(names, VERSIONS)]
    several = [n for n in free if len(levels[n]) > 1]
    first = [] if levels and len(levels[0]) == 1 else several
    found = [n for n in several if not _are_numbered(levels[n])] or first or free[:1]
    return [*found] or [None]


def _tokens(levels: Sequence[Sequence[str]], classes: int | None) -> list[str]:
    """Return the part of a pattern that stands for each level of folders."""
    tokens = ["{split}" if _are(names, SPLITS) else "*" for names in levels]
    free = []
    for at, names in enumerate(levels):
        if at == classes:
            tokens[at] = "{label}"
        elif _are(names, VERSIONS):
            tokens[at] = min(names, key=lambda name: not is_called(name, PLAIN))
        elif tokens[at] == "*" and (len(names) > 1 or _are_numbered(names)):
            free.append(at)
    for at in sorted(free, key=lambda n: (len(levels[n]) == 1, not _are_people(levels[n])))[:1]:
        tokens[at] = "{group}"
    return tokens


def words(name: str) -> list[str]:
    """Divide a name into words and numbers.

    Example:
        >>> from tex_lightning.data.readers.layout import words
        >>> words("Test data/oak_1Raw")
        ['test', 'data', 'oak', '1', 'raw']
    """
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return re.findall(r"[^\W\d_]+|\d+", apart.casefold())


def is_called(name: str, known: set[str]) -> bool:
    """Return whether a name is of these words, beside numbers and words such as ``data``."""
    named = words(name)  # fold alone may be one of cloth
    said = [word for word in named if not word.isdecimal() and word not in FILLERS]
    return bool(said) and {*said} <= known and named != ["fold"]


def _are(names: Sequence[str], known: set[str]) -> bool:
    return bool(names) and all(is_called(name, known) for name in names)


def _are_numbered(names: Sequence[str]) -> bool:
    """Return whether names differ in numbers alone, such as ``P01`` and ``P02`` or dates."""
    return len({re.sub(r"\d+", "#", name.casefold()) for name in names} - {*names}) == 1 and all(
        re.search(r"\d", name) for name in names
    )


def _are_people(names: Sequence[str]) -> bool:
    """Return whether names are such as ``P01`` and ``P02`` rather than ``1`` and ``2``."""
    return _are_numbered(names) and names[0][:1].isalpha()


def is_sense(part: str) -> bool:
    """Return whether a folder is called as one of the package's senses, or may mean one."""
    return modality_named(part.casefold()) in MODALITIES or bool(_meant(part))


def _meant(name: str) -> str:
    return MEANT.get(name.casefold().removesuffix("s"), "")


def _sense_token(part: str) -> str:
    return "{modality}" if is_sense(part) else "*"


def tables_of_labels(root: Path) -> Iterable[Recordings]:
    """Yield the tables in a folder that name recordings and their classes, noting how to read."""
    inside = [path for folder in META for path in root.glob(f"{folder}/*")]
    for path in sorted([*root.glob("*"), *inside]):
        if not is_hidden(path, root) and (table := names_recordings(path)) is not None:
            note = (
                f"the table {path.name} names recordings and their classes; "
                f"data=manifest {shlex.quote(f'data.manifest={path}')} reads it"
            )
            yield Recordings(table.rows, (*table.notes, note))


def flat_patterns(paths: Sequence[Path]) -> list[tuple[Sequence[str], str]]:
    """Return patterns of the names of files in one folder, with the classes where in doubt.

    If all names have as many parts, as ``P01_oak_3``, each is taken as a level of folders would be.
    Else they are a class, a separator if any, and a number; there is no pattern of mere words.
    """
    stems, suffixes = [path.stem for path in paths], {path.suffix for path in paths}
    ending = paths[0].suffix if len(suffixes) == 1 else ".*"
    numbered = all(re.search(r"\D\d+$", stem) for stem in stems)
    mark = next((mark for mark in SEPARATORS if all(mark in stem for stem in stems)), "")
    divided = [stem.split(mark) for stem in stems] if mark else []
    told = _by_parts(divided, mark) if len({*map(len, divided)}) == 1 else []
    patterns = told or ([([], f"{{label}}{mark}{{group}}")] if mark or numbered else [])
    return [(classes if len(told) > 1 else (), pattern + ending) for classes, pattern in patterns]


def _by_parts(names: Sequence[Sequence[str]], mark: str) -> list[tuple[list[str], str]]:
    """Return the classes and patterns of names in as many parts, if parts come back that are words.

    Args:
        names: Parts of each name.
        mark: What stood between them.
    """
    levels = [[*dict.fromkeys(each)] for each in zip(*names, strict=True)]
    plain = [level for level in levels if len(level) > 1 and not all(map(is_sense, level))]
    told = []
    for at in _levels_of_classes(plain):
        if at is None or len(plain[at]) == len(names) or _are_numbered(plain[at]):
            continue
        tokens = iter(_tokens(plain, at))
        parts = [
            next(tokens) if level in plain else level[0] if len(level) == 1 else "{modality}"
            for level in levels
        ]
        told.append((plain[at], mark.join(parts)))
    return told


def doubts(root: Path, rows: Sequence[Recording]) -> list[str]:
    """Return what is in doubt of a table that was read from folders of classes."""
    return [*_labels_otherwise(root, rows), *_formats(rows), *_sessions_as_classes(root, rows)]


def _labels_otherwise(root: Path, rows: Sequence[Recording]) -> Iterable[str]:
    labels = {resolved(row.path): row.label for row in rows}
    for table in tables_of_labels(root):
        if any(labels.get(row.path, row.label) != row.label for row in table):
            yield f"Classes are the names of folders, but {table.notes[-1]}, and it has others."


def _formats(rows: Sequence[Recording]) -> list[str]:
    """Say which files have one name and two suffixes, and are in one group for it."""
    names: dict[object, list[Path]] = defaultdict(list)
    for row in rows:
        names[row.modality, row.path.with_suffix("")].append(row.path)
    twice = [paths for paths in names.values() if len(paths) > 1]
    if not twice:
        return []
    one, other = twice[0][:2]
    return [
        f"{inflected(len(twice), 'recording is', 'recordings are')} there in two formats by their "
        f"names, {one} and {other.name} for one; they are in one group, but delete one format if "
        "both hold the same."
    ]


def _sessions_as_classes(root: Path, rows: Sequence[Recording]) -> list[str]:
    """Say where folders read as classes may be sessions or people, by numbers or files alike."""
    names = sorted({row.label for row in rows})
    path = next((row.path for row in rows), root)
    inside = "".join(f"{_sense_token(part)}/" for part in path.relative_to(root).parts[1:-1])
    stems, tail = _without_numbers(names)
    if 1 < len(stems) <= len(names) / 2 and all(re.search(r"\d$", name) for name in names):
        pattern = f"{{label}}{tail}{{group}}/{inside}*{path.suffix}"
        return [f"{listed(names)} are classes of their own; {by_pattern(root, (stems, pattern))}."]
    if found := crossed(names):
        pattern = f"{{label}}{found[1]}{{group}}/{inside}*{path.suffix}"
        told = by_pattern(root, (found[0], pattern))
        return [f"{listed(names)} are classes of their own; {told}."]
    files: dict[str, set[str]] = defaultdict(set)
    for row in rows:
        files[row.label].add(row.path.stem)
    shared = {_without_numbers(sorted(each)) for each in files.values()}
    heads, tail = next(iter(shared), ((), ""))
    fewest = min(map(len, files.values()), default=0)
    several = len(heads) <= fewest / (1 if _are_numbered(names) else 2) and not _are(heads, SPLITS)
    words = all(re.fullmatch(r"[^\W\d_].*", head) for head in heads)
    if len(names) > 1 == len(shared) < len(heads) and several and words:
        pattern = f"{{group}}/{inside}{{label}}{tail}{'*' if tail else '{take}'}{path.suffix}"
        return [f"{listed(names)} are read as the classes; {by_pattern(root, (heads, pattern))}."]
    return []


def crossed(names: Sequence[str]) -> tuple[list[str], str, tuple[str, ...]] | None:
    """Return with what oak_wet, oak_dry, elm_wet, ... begin, the mark behind it, and their ends."""
    for mark in SEPARATORS:
        heads, ends = ({name.rpartition(mark)[at] for name in names} for at in (0, 2))
        if "" not in heads and 1 < len(heads) < len(names) == len(heads) * len(ends):
            return sorted(heads), mark, tuple(sorted(ends))
    return None


def _without_numbers(names: Sequence[str]) -> tuple[tuple[str, ...], str]:
    """Return names without the numbers at their ends, and without what stands before all of these.

    Example:
        >>> from tex_lightning.data.readers.layout import _without_numbers
        >>> _without_numbers(["oak-day1", "oak-day2", "elm-day1"])
        (('elm', 'oak'), '-day')
    """
    stems = sorted({re.sub(r"\d+$", "", name) for name in names})
    ends = [stems[0][mark.start() :] for mark in re.finditer(r"[\W_]", stems[0])]
    tail = next((end for end in ends if all(stem.removesuffix(end) for stem in stems)
                 and all(stem.endswith(end) for stem in stems)), "")  # fmt: skip
    return tuple(stem.removesuffix(tail) for stem in stems), tail
