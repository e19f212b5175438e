"""Patterns of the names of files, and of folders above them, that may have the classes in them."""

import re
from collections import Counter
from collections.abc import Sequence
from itertools import takewhile
from operator import itemgetter
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
from tex_lightning_runtime.files import natural_key

MOST = 0.8  # of the names, which have as many parts
MARKS = "_- ."  # between the parts of a name
PERSON = re.compile(
    r"(s|p|sub|subj|subject|participant|person|proband|user|actor|volunteer|patient|operator|session"
    r"|day)[_ -]?\d+",
    re.IGNORECASE,
)
DATE = re.compile(r"(?<!\d)(19|20)\d\d([-_.]?\d\d){2}(?!\d)")
TAKES = re.compile(
    r"(take|trial|trip|rec|rep|repetition|try|run|t|r|v|version|nr?|no)\d+", re.IGNORECASE
)
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


def path_ending(paths: Sequence[Path]) -> str:
    """Return the suffix of all paths, as a pattern has it."""
    return paths[0].suffix if len({path.suffix for path in paths}) == 1 else ".*"


def flat_patterns(paths: Sequence[Path]) -> list[tuple[Sequence[str], str]]:
    """Return patterns of the names of files in one folder, each with the classes that it gives.

    If all names have as many parts, as ``P01_oak_3``, each is taken as a level of folders would be.
    Else they are a class between numbers, or a class, a separator if any, and a number; there is no
    pattern of mere words.
    """
    ending = path_ending(paths)
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
        decimals = mark == "." and all(map(str.isdecimal, heads))
        if not (decimals or any(map(DATE.search, heads))):
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
    for at in levels_of_words(plain) or _level_of_numbers(plain, len(names)):
        if len(plain[at]) == len(names):
            continue
        tokens = iter(tokens_of(plain, at))
        parts = [
            next(tokens) if level in plain else level[0] if len(level) == 1 else "{modality}"
            for level in levels
        ]
        told.append((plain[at], mark.join(parts)))
    return told


def _level_of_numbers(levels: Sequence[Sequence[str]], files: int) -> list[int]:
    """Return the first level of numbers or codes that may be classes: no people, dates or takes."""
    if any(re.fullmatch(r"(19|20)\d\d", name) for level in levels for name in level):
        return []
    shared = (
        at
        for at, level in enumerate(levels[:-1])
        if 1 < len(level) < files
        and all(re.fullmatch(r"[^\W\d_]{0,3}\d{1,3}", name) for name in level)
        and not any(PERSON.fullmatch(name) or TAKES.fullmatch(name) for name in level)
    )
    return [*shared][:1]


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


def shared_part(paths: Sequence[Path], labels: Sequence[str]) -> tuple[list[str], int, str] | None:
    """Find the part of names that several files of a class share, such as the person of P1_3.

    Args:
        paths: The files.
        labels: Their classes, whose names may stand in those of the files.

    Returns:
        The values of this part, the number of a file that shares one, and a pattern of the names
        with ``{group}`` in its place; None if there is no such part.
    """
    own = {each: re.compile(rf"(?<![^\W_]){re.escape(each)}(?![^\W_])", re.I) for each in {*labels}}
    stems = [
        own[label].sub("*", PIECE.sub("", path.stem))
        for path, label in zip(paths, labels, strict=True)
    ]
    found = []
    for mark in [mark for mark in MARKS if any(mark in stem for stem in stems)] or MARKS[0]:
        sizes = Counter(stem.count(mark) for stem in stems)
        size, count = sizes.most_common(1)[0]
        alike = [at for at, stem in enumerate(stems) if stem.count(mark) == size]
        names = [stems[at].split(mark) for at in alike] if count >= MOST * len(stems) else []
        levels = [*zip(*names, strict=True)]
        own_labels = [labels[at] for at in alike]
        for at, level in enumerate(levels):
            rank = _rank(level, last=at == len(levels) - 1)
            if rank is not None and _recur(names, own_labels, level):
                tokens = [values[0] if _are_one(values) else "*" for values in levels]
                tokens[at] = "{group}"
                found.append((rank, level, alike, mark.join(tokens)))
    if not found:
        return None
    _, level, alike, pattern = min(found, key=itemgetter(0))
    counts = Counter(level)
    first = next(at for at, value in zip(alike, level, strict=True) if counts[value] > 1)
    ends = [paths[at] for at in alike]
    pattern += "*" * any(PIECE.search(path.stem) for path in ends) + path_ending(ends)
    return sorted({*level}, key=natural_key), first, pattern


def _recur(names: Sequence[Sequence[str]], labels: Sequence[str], values: Sequence[str]) -> bool:
    """Return whether most files share a value with others of their class, but not with all.

    People may as well be those of other classes, if not all of them are in each.
    """
    files = {*zip(labels, values, map(tuple, names), strict=True)}
    counts = Counter((label, value) for label, value, _ in files)
    several = Counter(label for label, _ in counts)
    alike = [pair for pair, count in counts.items() if count > 1 and several[pair[0]] > 1]
    if sum(counts[pair] for pair in alike) > len(files) / 2:
        return True
    people = Counter(value for _, value in counts)  # with the number of their classes
    named = all(map(PERSON.fullmatch, people))
    return named and max(people.values()) > 1 and min(people.values()) < len({*labels})


def _rank(values: Sequence[str], *, last: bool) -> int | None:
    """Return how likely a part of names is a person or session, from 0; None of one that is not."""
    names = sorted({*values})
    if are(names, SPLITS | VERSIONS) or all(map(is_sense, names)):
        return None
    if all(re.fullmatch(r"[\da-f]{8,}|(\d+-){2}\d+", name, re.I) for name in names):
        return 0
    coded = all(re.fullmatch(r"[a-z]\d{1,3}", name, re.I) for name in names)  # as f1 and m1
    if (coded or are_people(names)) and not any(map(TAKES.fullmatch, names)):
        return 0
    plain = all(name.isdecimal() for name in names) or not re.search(r"\d", "".join(names))
    return 1 if (plain or are_people(names)) and not last else None
