"""Find classes, groups and conditions in the names of files, for ``task=manifest``."""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from tex_lightning.data.manifest import FOLD, KNOWN, PART, RATE, modality_by_suffix
from tex_lightning.data.readers.file_names import uncut
from tex_lightning.data.readers.folder import suffixes_of
from tex_lightning.data.readers.layout import formats
from tex_lightning.data.readers.siblings import (
    check_sensors,
    made_together,
    pieces,
    split_lists,
    without_versions,
)
from tex_lightning.data.readers.vocabulary import is_about, words
from tex_lightning.data.recordings import (
    Recording,
    Recordings,
    is_hidden,
    modality_named,
)
from tex_lightning.errors import UserError, shorten
from tex_lightning_runtime.files import natural_key
from tex_lightning_runtime.photos import IMAGE_SUFFIXES
from tex_lightning_runtime.traces import TRACE_SUFFIXES, stands_for_all

FIELD = re.compile(r"\{([^{}]*)\}|(\*\*/|\*)")
LABEL, GROUP, MODALITY = "label", "group", "modality"


def read_names(root: Path, pattern: str) -> tuple[Recordings, list[str]]:
    """Return the recordings below a folder whose names fit a pattern, and the names that do not.

    Args:
        root: The folder.
        pattern: Path below the folder, such as ``{label}/{person}_{group}.wav``. What stands for
            ``{label}`` is the class, and may have the separators; for ``{group}``, ``{modality}``,
            ``{rate}`` and ``{fold}`` the columns of a manifest; for others conditions. ``*`` is
            anything, ``**/`` any folders, and what follows another directly is a number. Without
            ``{modality}`` the suffix tells it, and without ``{group}`` files of one name, whatever
            their suffix and modality, are a group, as are pieces of one recording, ``r1_seg01`` and
            ``r1_seg02``.

    Raises:
        UserError: If the pattern cannot be used, or no name fits.

    Example:
        >>> from pathlib import Path
        >>> from tex_lightning.data.readers.path_pattern import read_names
        >>> _ = Path("A.wav").rename("red_oak_ann.wav")
        >>> table, others = read_names(Path(), "{label}_{person}.wav")
        >>> table.rows[0].label, table.rows[0].conditions
        ('red_oak', (('person', 'ann'),))
    """
    if not root.is_dir():
        raise UserError(f"Folder {root} does not exist; give an existing folder in data.root.")
    wanted, rows, others = _compiled(pattern), [], []
    for path in _files(root):
        name = path.relative_to(root).as_posix()
        about = is_about(path) and words(path.stem)[-1] not in words(pattern)  # of the recordings
        match = None if about else wanted.fullmatch(name)
        row = match and _recording(path, name, match.groupdict())
        if row and path.suffix.lower() in suffixes_of(row.modality):
            rows.append(row)
        else:
            others.append(name)
    if not rows:
        seen = f"such as {shorten(others[0])}" if others else "as there is no recording in it"
        raise UserError(
            f"No file in {root} has a name like pattern={shorten(pattern)}, {seen}; correct the "
            "pattern, which is a path below data.root."
        )
    if f"{{{GROUP}}}" not in pattern:
        rows = _with_pieces_together(rows)
    check_sensors(root, rows)
    table = without_versions(root, rows)
    notes = [*table.notes, *pieces(table.rows), *formats(table.rows)]
    notes += split_lists(root, table.rows)
    if (free := re.fullmatch(r"(.+/)\*(\.(\w+|\*))?", pattern)) and f"{{{GROUP}}}" not in pattern:
        notes += made_together(root, table.rows, free[1])
    return replace(table, notes=tuple(notes)), others


def _with_pieces_together(rows: Sequence[Recording]) -> list[Recording]:
    groups: dict[str, list[str]] = defaultdict(list)
    for row in rows:
        groups[row.label].append(str(row.group))
    whole = {label: dict(zip(names, uncut(names), strict=True)) for label, names in groups.items()}
    return [replace(row, group=whole[row.label][str(row.group)]) for row in rows]


def _files(root: Path) -> Iterator[Path]:
    """Yield the recordings below a folder in natural order; one of several that are its axes."""
    suffixes = (*TRACE_SUFFIXES, *IMAGE_SUFFIXES)
    visible = (path for path in root.rglob("*") if not is_hidden(path, root))
    for path in sorted(visible, key=lambda path: natural_key(path.as_posix())):
        usable = path.suffix.lower() in suffixes and path != root / "manifest.csv"
        if usable and path.is_file() and stands_for_all(path):
            yield path


def _compiled(pattern: str) -> re.Pattern[str]:
    """Return the regular expression of a pattern."""
    names = [match[1] for match in FIELD.finditer(pattern) if match[1] is not None]
    for name in names:
        if not name.isidentifier() or name in ("path", PART) or names.count(name) > 1:
            raise UserError(
                f"pattern={shorten(pattern)} has {{{name}}}; give each part another name, one "
                "word, and neither path nor part."
            )
    if LABEL not in names:
        raise UserError(f"pattern={shorten(pattern)} has no {{label}}; say where the class is.")
    parts, end = [], 0
    for match in FIELD.finditer(pattern):
        parts.append(re.escape(pattern[end : match.start()]))
        end = match.end()
        behind = "" if re.fullmatch(r"\.(\w+|\*)", pattern[end:]) else pattern[end : end + 1]
        beside = re.escape(pattern[match.start() - 1 : match.start()] + behind)
        only = rf"[^/{beside}]+" if match[1] != LABEL else "[^/]+"
        if match.start() and pattern[match.start() - 1] == "}":  # a number directly behind a name
            only = r"(?<!\d)\d+"
        anything = "(?:.*/)?" if match[2] == "**/" else "[^/]*"
        parts.append(anything if match[2] else f"(?P<{match[1]}>{only})")
    return re.compile("".join([*parts, re.escape(pattern[end:])]))


def _recording(path: Path, name: str, told: dict[str, str]) -> Recording:
    """Make the recording of a file; its values are checked when the manifest is read."""
    place = name.removesuffix(path.suffix)
    if MODALITY in told:  # a stroke and a photo of one name are a group
        place = "/".join(part for part in place.split("/") if part != told[MODALITY])
    group = told.get(GROUP, place)
    try:
        rate = float(told[RATE]) if RATE in told else None
        fold = int(told[FOLD]) if FOLD in told else None
    except ValueError as error:
        raise UserError(f"{path} has a rate or fold that is no number ({error}).") from error
    conditions = tuple((key, value) for key, value in told.items() if key not in KNOWN)
    modality = modality_named(told.get(MODALITY, modality_by_suffix(path)))
    return Recording(told[LABEL], modality, path, group, rate, conditions, fold=fold)
