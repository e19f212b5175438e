"""What folders and names above and beside recordings mean, where they are not those of classes.

Folders of people, sessions or days above or below the classes, parts such as ``train``, versions
such as ``raw`` and ``filtered``, a table of labels: what is in doubt is told, with the command that
reads it.
"""

import re
import shlex
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from tex_lightning.core.files import resolved
from tex_lightning.data.manifest import META, names_recordings
from tex_lightning.data.readers.file_names import (
    PERSON,
    flat_patterns,
    free_levels,
    levels_of_words,
    path_ending,
    tokens_of,
)
from tex_lightning.data.readers.vocabulary import (
    ASIDE,
    PLAIN,
    SPLITS,
    VERSIONS,
    are,
    are_numbered,
    are_people,
    is_called,
    is_sense,
    rename,
)
from tex_lightning.data.recordings import Recording, Recordings, is_hidden
from tex_lightning.errors import inflected, listed
from tex_lightning_runtime.files import expanded

BY_MANIFEST = "give their classes in a manifest (docs/data.md, Manifest)"
MAX_CLASSES = 200  # that names of files are told to have
SEPARATORS = "_- "  # in names of folders


def by_pattern(root: Path, *patterns: tuple[Sequence[str], str]) -> str:
    """Say how a manifest is made by one of several patterns, each with the classes that it gives.

    Args:
        root: The folder.
        patterns: The classes, where there are several and they are in doubt, and the pattern.
    """
    folder = shlex.quote(f"data.root={root}")
    told = []
    for classes, pattern in patterns:
        which = f"if {listed(classes)} are the classes, " if len(classes) > 1 else ""
        told.append(f"{which}run task=manifest {folder} pattern='{_named_once(pattern)}'")
    return f"{'; '.join(told)}, and train with data=manifest"


def _named_once(pattern: str) -> str:
    """Return a pattern in which a part that stands there for a second time is anything."""
    found = re.split(r"(\{\w+\})", pattern)
    return "".join("*" if n % 2 and part in found[:n] else part for n, part in enumerate(found))


def advise(root: Path, paths: Sequence[Path], name: str = "*") -> str:
    """Say how recordings are read whose folders are not those of classes and senses alone.

    Args:
        root: Folder of the data set.
        paths: Some of the recordings.
        name: Pattern of their names.
    """
    if named := _named_in(root, paths):
        return named
    folders = _of_recordings({path: path.relative_to(root).parts[:-1] for path in paths})
    depths = Counter(map(len, folders.values()))
    depth = min(depths, key=lambda depth: (-depths[depth], depth))  # of most recordings
    files = {path: parts for path, parts in folders.items() if len(parts) == depth}
    levels = [[*dict.fromkeys(each)] for each in zip(*map(_own, files.values()), strict=True)]
    patterns = [] if len(depths) == 1 else _deep_patterns(folders, min(depths), name)
    patterns += _patterns([*files], levels, name)
    return by_pattern(root, *patterns) if patterns else BY_MANIFEST


def _own(parts: Sequence[str]) -> list[str]:
    """Return the names of folders without that above: of oak/oak-2026-05-01 the date remains."""
    pairs = zip(["", *parts], parts, strict=False)
    return [name.removeprefix(above) if re.match(rf"{re.escape(above)}[\W_]", name) else name
            for above, name in pairs]  # fmt: skip


def _deep_patterns(
    folders: Mapping[Path, Sequence[str]], depth: int, name: str
) -> list[tuple[Sequence[str], str]]:
    """Return patterns of files in as many folders and more, whose classes are folders."""
    above = zip(*(parts[:depth] for parts in folders.values()), strict=True)
    levels = [[*dict.fromkeys(each)] for each in above]
    return [
        (levels[at], "/".join([*tokens_of(levels, at), "**", f"{name}{path_ending([*folders])}"]))
        for at in levels_of_words(levels)
        if not any(map(is_sense, levels[at]))
    ]


def _of_recordings(folders: Mapping[Path, Sequence[str]]) -> Mapping[Path, Sequence[str]]:
    """Return the folders of files without those that are results, or masks beside images.

    Args:
        folders: Names of the folders above each file.
    """
    aside = ASIDE - SPLITS
    kept = {p: f for p, f in folders.items() if not any(is_called(part, aside) for part in f)}
    for level in range(min(map(len, kept.values()), default=0)):
        names = {parts[level] for parts in kept.values()}
        versions = {part for part in names if is_called(part, VERSIONS - PLAIN)}
        if versions < names and all(map(is_sense, names - versions)):
            kept = {p: f for p, f in kept.items() if f[level] not in versions}
    return kept or folders


def _patterns(
    files: Sequence[Path], levels: Sequence[Sequence[str]], name: str
) -> list[tuple[Sequence[str], str]]:
    """Return the patterns that recordings in folders of these levels may have, with the classes.

    The classes are folders that differ in words, or parts of the names of the files that do, or
    else folders that differ in numbers, as people, sessions and days do.
    """
    senses = [all(map(is_sense, names)) for names in levels]
    plain = [names for names, sense in zip(levels, senses, strict=True) if not sense]
    suffixes = {path.suffix for path in files}
    ending = f"{name}{files[0].suffix if len(suffixes) == 1 else '' if name == '*' else '*'}"

    def above(classes: int | None) -> str:
        tokens = iter(tokens_of(plain, classes))
        return "".join(f"{'{modality}' if sense else next(tokens)}/" for sense in senses)

    free = free_levels(plain)
    found = levels_of_words(plain)
    known = [{*map(str.casefold, plain[n])} for n in free]
    names = [
        (classes, pattern)
        for classes, pattern in flat_patterns(files)
        if name.strip("*") in pattern and {*map(str.casefold, classes)} not in known
        and not (found and are_numbered(classes))
    ]  # fmt: skip
    numbered = [] if found else [n for n in free if len(plain[n]) > 1]
    if not (found or names or numbered):
        found = free[:1]
    if not (found or names or numbered or name.strip("*")):
        marked = "_{group}" if all("_" in path.stem for path in files) else ""
        names = [((), f"{{label}}{marked}{ending.removeprefix(name) or '.*'}")]
    end = "{take}" if "{group}" in above(None) else "{group}"
    by_folders = [(plain[at], above(at) + ending) for at in found]
    return [
        *(each for own in by_folders for each in (*_without_ends(*own), own)),
        *((classes, above(None) + each.replace("{group}", end)) for classes, each in names),
        *((plain[at], above(at) + ending) for at in numbered),
    ]


def _without_ends(names: Sequence[str], pattern: str) -> list[tuple[Sequence[str], str]]:
    """Return what folders such as oak_1, oak_2, elm_1 are if their numbers are groups."""
    return [
        (stems, pattern.replace("{group}", "*").replace("{label}", f"{{label}}{tail}{{group}}"))
        for stems, tail in filter(None, [_numbered(names)])
    ]


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
    alone = len({row.label for row in rows}) == 1
    text = _named_in(folder, paths) if paths else ""
    apart = not alone or len({path.parent for path in paths}) > 1
    if (deep and apart) or (alone and flat_patterns(paths)):
        text = advise(folder, paths)
    return [f"{text[:1].upper()}{text[1:]}."] if text else []


def _named_in(root: Path, paths: Sequence[Path]) -> str:
    """Say which table in a folder names some of the recordings and their classes; empty if none."""
    known = {resolved(path) for path in paths}
    tables = (table for table in tables_of_labels(root) if {row.path for row in table} & known)
    return next((table.notes[-1] for table in tables), "")


def sense_token(part: str) -> str:
    """Return the part of a pattern that stands for a folder below that of a class."""
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


def doubts(root: Path, rows: Sequence[Recording]) -> list[str]:
    """Return what is in doubt of a table that was read from folders of classes."""
    return [*_labels_otherwise(root, rows), *formats(rows), *_sessions_as_classes(root, rows)]


def _labels_otherwise(root: Path, rows: Sequence[Recording]) -> Iterable[str]:
    labels = {resolved(row.path): row.label for row in rows}
    for table in tables_of_labels(root):
        if any(labels.get(row.path, row.label) != row.label for row in table):
            yield f"Classes are the names of folders, but {table.notes[-1]}, and it has others."


def formats(rows: Sequence[Recording]) -> list[str]:
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
    inside = "".join(f"{sense_token(part)}/" for part in path.relative_to(root).parts[1:-1])
    if found := _numbered(names) or crossed(names):
        persons = all(PERSON.fullmatch(row.path.stem) for row in rows)
        end, name = ("*", "{group}") if persons else ("{group}", "*")
        ending = f"/{inside}{name}{path.suffix}"
        told = [(found[0], f"{{label}}{found[1]}{end}{ending}")]
        if not any(found[1] in head for head in found[0]):
            told += [(ends, f"{end}{found[1]}{{label}}{ending}") for ends in found[2:]]
        return [f"{listed(names)} are classes of their own; {by_pattern(root, *told)}."]
    others = [
        (classes, f"{{group}}/{inside}{pattern}") for classes, pattern in classes_in_names(rows)
    ]
    return (
        [f"{listed(names)} are read as the classes; {by_pattern(root, *others)}."] if others else []
    )


def classes_in_names(rows: Sequence[Recording]) -> list[tuple[Sequence[str], str]]:
    """Return which classes the files may have by their names, with patterns, in folders alike."""
    files: dict[str, set[str]] = defaultdict(set)
    for row in rows:
        files[row.label].add(row.path.stem)
    names = sorted(files)
    fewest = min(map(len, files.values()), default=0)
    fewest //= 1 if are_numbered(names) else 2
    paths = [row.path for row in rows]
    found = [
        (classes, pattern.replace("{group}", "{take}"))
        for classes, pattern in flat_patterns(paths)
        if len(names) > 1 < len(classes) <= min(fewest, MAX_CLASSES) and not are(classes, SPLITS)
        and (are_people(names)
             or all(re.search(r"^[^\W\d_]|[^\W\d_]{2}", each) for each in classes))
        and "{label}." not in pattern
        and all(any(each in stem for stem in files[name]) for name in files for each in classes)
    ]  # fmt: skip
    alike = {stem for stem in files[names[0]] if not re.search(r"\d", stem)} if names else set()
    same = len(names) > 1 and all(stems == alike for stems in files.values())
    if same and len(alike) > 1 and not found:
        found.append((sorted(alike), f"{{label}}{path_ending(paths)}"))
    return found


def crossed(names: Sequence[str]) -> tuple[list[str], str, tuple[str, ...]] | None:
    """Return with what oak_wet, oak_dry, elm_wet, ... begin, the mark behind it, and their ends."""
    for mark in SEPARATORS:
        heads, ends = ({name.rpartition(mark)[at] for name in names} for at in (0, 2))
        if "" not in heads and 1 < len(heads) < len(names) == len(heads) * len(ends):
            return sorted(heads), mark, tuple(sorted(ends))
    return None


def _numbered(names: Sequence[str]) -> tuple[tuple[str, ...], str] | None:
    """Return what several names have before the numbers at their ends, if they all have several."""
    stems, tail = _without_numbers(names)
    several = 1 < len(stems) <= len(names) / 2
    return (stems, tail) if several and all(re.search(r"\d$", name) for name in names) else None


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
