"""Patterns of the names of files, and of folders above them, that may have the classes in them."""

import re
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

from tex_lightning.data.readers.vocabulary import (
    PLAIN,
    SPLITS,
    VERSIONS,
    are,
    are_numbered,
    are_people,
    is_called,
    is_sense,
)

MARKS = "_- ."  # between the parts of a name
PIECE = re.compile(  # ends of names of what was cut from one recording
    r"[_. -](seg(ment)?|chunk|part|win(dow)?|slice|clip|piece|crop|patch|tile|frame|burst|aug"
    r"|rot)s?[_. -]?\d+$",
    re.IGNORECASE,
)


def free_levels(levels: Sequence[Sequence[str]]) -> list[int]:
    """Return the levels of folders that are no parts or versions of the data set."""
    return [n for n, names in enumerate(levels) if not are(names, SPLITS) | are(names, VERSIONS)]


def levels_of_words(levels: Sequence[Sequence[str]]) -> list[int]:
    """Return the levels of folders that may be the classes, as they differ in words."""
    return [n for n in free_levels(levels) if len(levels[n]) > 1 and not are_numbered(levels[n])]


def tokens_of(levels: Sequence[Sequence[str]], classes: int | None) -> list[str]:
    """Return the part of a pattern that stands for each level of folders."""
    tokens = ["{split}" if are(names, SPLITS) else "*" for names in levels]
    free = []
    for at, names in enumerate(levels):
        if at == classes:
            tokens[at] = "{label}"
        elif are(names, VERSIONS):
            tokens[at] = min(names, key=lambda name: not is_called(name, PLAIN))
        elif tokens[at] == "*" and (len(names) > 1 or are_numbered(names)):
            free.append(at)
    for at in sorted(free, key=lambda n: (len(levels[n]) == 1, not are_people(levels[n])))[:1]:
        tokens[at] = "{group}"
    return tokens


def flat_patterns(paths: Sequence[Path]) -> list[tuple[Sequence[str], str]]:
    """Return patterns of the names of files in one folder, each with the classes that it gives.

    If all names have as many parts, as ``P01_oak_3``, each is taken as a level of folders would be.
    Else they are a class between numbers, or a class, a separator if any, and a number; there is no
    pattern of mere words.
    """
    suffixes = {path.suffix for path in paths}
    ending = paths[0].suffix if len(suffixes) == 1 else ".*"
    if cut := len(paths) > 0 and all(PIECE.search(path.stem) for path in paths):
        ending = f"_*{ending}"
    stems = [PIECE.sub("", path.stem) if cut else path.stem for path in paths]
    marks = [mark for mark in MARKS if all(mark in stem for stem in stems)]
    found = []
    for mark in marks:
        names = [stem.split(mark) for stem in stems]
        found += [(_by_parts if len({*map(len, names)}) == 1 else _between)(names, mark)]
    found = sorted(filter(None, found), key=lambda each: each[-1][1].endswith("{label}"))
    told = found[0] if found else []
    for mark in marks or [""] * all(re.search(r"\D\d+$", stem) for stem in stems):
        heads = {stem.rpartition(mark)[0] if mark else stem.rstrip("0123456789") for stem in stems}
        told = told or [(sorted(heads), f"{{label}}{mark}{{group}}")][: len(heads) - 1]
    return [(classes, pattern + ending) for classes, pattern in told]


def _by_parts(names: Sequence[Sequence[str]], mark: str) -> list[tuple[list[str], str]]:
    """Return the classes and patterns of names in as many parts, if parts come back that are words.

    Args:
        names: Parts of each name.
        mark: What stood between them.
    """
    levels = [[*dict.fromkeys(each)] for each in zip(*names, strict=True)]
    plain = [
        level
        for level in levels
        if (len(level) > 1 or are_numbered(level)) and not all(map(is_sense, level))
    ]
    told = []
    for at in levels_of_words(plain):
        if len(plain[at]) == len(names):
            continue
        tokens = iter(tokens_of(plain, at))
        parts = [
            next(tokens) if level in plain else level[0] if len(level) == 1 else "{modality}"
            for level in levels
        ]
        told.append((plain[at], mark.join(parts)))
    return told


def _between(names: Sequence[Sequence[str]], mark: str) -> list[tuple[list[str], str]]:
    """Return the classes and the pattern of names whose classes have several parts, or one.

    Args:
        names: Parts of each name.
        mark: What stood between them.
    """
    above = [same[0] for same in takewhile(_are_one, zip(*names, strict=False))]
    rest = [name[len(above) :] for name in names]
    fewest = min(map(len, rest), default=1) - 1
    first = int(fewest > 0 and are_numbered([name[0] for name in rest]))
    last = 0
    while last < fewest - first:
        parts = [name[-1 - last] for name in rest]
        if not (_are_one(parts) or are_numbered(parts)):
            break
        last += 1
    classes = {mark.join(name[first : len(name) - last]) for name in rest}
    ends = [[*dict.fromkeys(name[at] for name in rest)] for at in range(-last, 0)]
    behind = ["*"] * last if first else tokens_of(ends, None)
    told = mark.join([*above, *["{group}"] * first, "{label}", *behind])
    return [(sorted(classes), told)] if first + last and len(classes) > 1 else []


def _are_one(parts: Sequence[str]) -> bool:
    return len({*parts}) == 1


def uncut(names: Sequence[str]) -> Sequence[str]:
    """Return for each name of a class that of the recording, unless all are pieces of one."""
    whole = [PIECE.sub("", name) for name in names]
    return names if len({*whole}) == 1 < len({*names}) else whole
