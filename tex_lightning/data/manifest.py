"""The CSV manifest of a table of recordings: read, with what its author may mean, and written."""

import csv
import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from io import StringIO
from pathlib import Path, PureWindowsPath
from typing import Any
from urllib.parse import unquote

from tex_lightning.core.files import resolved
from tex_lightning.data.recordings import (
    MODALITIES,
    Recording,
    Recordings,
    check_distinct,
    check_row,
    modality_named,
    read_part,
    write_part,
)
from tex_lightning.errors import UserError, reason, shorten
from tex_lightning.text import from_cell, to_cell
from tex_lightning_runtime.files import has_long_line, is_file, natural_key
from tex_lightning_runtime.photos import IMAGE_SUFFIXES
from tex_lightning_runtime.plain_text import read_utf8
from tex_lightning_runtime.times import TableError
from tex_lightning_runtime.traces import TRACE_SUFFIXES

COLUMNS = ("label", "modality", "path", "group")
RATE, PART, FOLD = "rate", "part", "fold"
KNOWN = (*COLUMNS, RATE, PART, FOLD)
SAMPLING = re.compile(  # names that a column of rates may have
    r"(sampl(e|es|ed|ing)?|acquisition|audio)(rate|freq\w*)(s|inhz|hz|khz)?|fs|k?hz|rate(in)?k?hz"
)
SEPARATORS = ",;\t|"
HEAD = 4096  # bytes of a first line that is looked at
NUMBER = re.compile("[0-9]{1,18}")  # longer ones are names
SAMPLES = (
    "; samples are no manifest: each recording has a file of its own (docs/data.md, Recordings in "
    "one file)"
)
MEANT = {  # other names of columns, in tables of labels as people have them, without separators
    "path": ("path", "paths", "file", "files", "filename", "filepath", "fname", "slicefilename"),
    "label": ("label", "labels", "class", "material", "category", "target", "surface", "texture",
              "classname", "classid", "terrain", "y"),
    "modality": ("modality",),
    "group": ("group",),
}  # fmt: skip
NEEDED = ("path", "label")
FILES = re.compile(  # a name of the only column of files, whose sense their suffix tells
    r"(?!sound|audio|mic).*(path|(?<!pro)file|filename|imagename)"
)
META = ("meta", "metadata", "labels", "annotations")  # folders of tables beside their recordings
LABELS = re.compile(r"\w*[a-z](label|class|category|material|surface|texture)|activity|gesture")
SESSIONS = re.compile(  # names of conditions that groups may be
    r"(session|subject|participant|person|user|operator|patient|specimen|day|date)(s?|_?id|_?no)"
)


SPAN = re.compile(  # names of conditions that parts may be
    r"(start|stop|begin|end|onset|offset|duration)([ _]?(time|sample|index|idx|frame|s|ms))?",
    re.IGNORECASE,
)


def read_manifest(path: str | Path) -> Recordings:
    r"""Read a table from CSV with the columns ``label,modality,path,group``.

    Relative paths are relative to the manifest, or else all of them to the folder above its own.
    Lines above the names may begin with ``#``; a bare name may be that of the only such file below
    it, or beside its folder ``meta``, with or without its suffix. Without a column ``modality``
    photos are known by their suffix, and all else is ``haptic``; without ``group`` files of one
    name are a group. A column ``rate`` (Hz) gives the rate of traces whose format states none. A
    column ``part``, such as ``0-0.5``, is the position of a recording in its file. A column
    ``fold`` fixes the folds: numbers from 0, or any other numbers or names, which are counted in
    natural order. All other columns are conditions of the recordings, such as speed, force or
    light. ``group`` is any text (:class:`Recording`).

    Raises:
        UserError: If the file is missing, a column is missing or a line cannot be understood.

    Example:
        >>> import tex_lightning as tl
        >>> from pathlib import Path
        >>> table = Path("table.csv")
        >>> _ = table.write_text("label,modality,path,group\noak,haptic,A.wav,0\n")
        >>> tl.read_manifest(table).classes
        ['oak']
    """
    path = Path(path)
    delimiter, names, lines = _read_lines(path)
    _check_names(path, names)
    files = _Files(path.parent, [from_cell(line["path"]) for line in lines.values()])
    rows = [_read_line(files, where, line, delimiter) for where, line in lines.items()]
    check_distinct(f"Manifest {path}", rows)
    if not rows:
        raise UserError(f"Manifest {path} lists no recordings; add lines {','.join(COLUMNS)}.")
    cells = {where: (line.get(FOLD) or "").strip() for where, line in lines.items()}
    folds, notes = _fixed_folds(cells)
    folded = zip(rows, folds, strict=True)
    return Recordings(
        tuple(replace(row, fold=fold) for row, fold in folded),
        (*notes, *_notes(path, names), *_files_in_conditions(names, lines)),
    )


ASSUMED = {
    "modality": "what is no photo is haptic",
    "group": "files of other names are groups of their own, which tests leave out one by one",
}


def _notes(path: Path, names: Sequence[str]) -> Iterator[str]:
    """Yield what is taken for granted in a manifest with columns of these names."""
    for name, how in ASSUMED.items():
        if name not in names:
            yield f"Manifest {path} has no column {name}: {how}."
    if "group" not in names:
        for name in filter(lambda name: SESSIONS.fullmatch(name.casefold()), names):
            yield (
                f"The column {name} is a condition; call it group if what shares one is to be left "
                "out together."
            )
    if PART not in names and len(spans := [name for name in names if SPAN.fullmatch(name)]) > 1:
        yield (
            f"The columns {' and '.join(spans)} are conditions, and files are read whole; give a "
            "column part, such as 0-0.5, if a part of a file is meant."
        )


def _files_in_conditions(
    names: Sequence[str], lines: Mapping[str, Mapping[Any, Any]]
) -> Iterator[str]:
    """Yield which conditions name files, such as photos beside the signals of ``path``."""
    for name in filter(lambda name: name and name not in KNOWN, names):
        cells = {line[name] for line in lines.values()} - {"", None}
        kinds = {Path(cell).suffix.lower() for cell in cells}
        if kinds and kinds <= {*TRACE_SUFFIXES, *IMAGE_SUFFIXES}:
            yield (
                f"The column {name} is a condition, and the files that it names are not read; give "
                "each file a line of its own if they are meant."
            )


def modality_by_suffix(path: Path) -> str:
    """Return the modality of a file if nothing but its suffix tells it."""
    return "image" if path.suffix.lower() in IMAGE_SUFFIXES else "haptic"


def names_recordings(path: Path) -> Recordings | None:
    """Return the recordings that a table lists with their classes; None of any other file."""
    if path.suffix.lower() not in (".csv", ".tsv", ".txt") or not is_file(path):
        return None
    with path.open("rb") as stream:
        first = stream.readline(HEAD).decode(errors="replace").lstrip("\ufeff")
    if not any({*NEEDED} <= {*_names([first], mark)} for mark in SEPARATORS):
        return None
    try:
        table = read_manifest(path)
    except UserError:
        return None
    return table if any(is_file(row.path) for row in table) else None


class _Files:
    """The files that a manifest may name.

    Args:
        folder: That of the manifest.
        names: All names in it.
    """

    def __init__(self, folder: Path, names: Sequence[str]) -> None:
        self.folder, self.names = folder, names

    def find(self, name: str) -> Path:
        """Return a file; a bare name may be that of one below."""
        found, plain = _found(self.folder, name), PureWindowsPath(name.strip())
        if found is None and plain.name == name.strip():
            below = self._below.get(plain.name, [])
            found = below[0] if len(below) == 1 else None
        elif found is None and ".." not in plain.parts and self._are_above:
            found = _found(self.folder.parent, name)
        return found or self.folder / name

    @cached_property
    def _are_above(self) -> bool:
        """Whether none is below; else one that is missing would be another folder's namesake."""
        found = (_found(self.folder, name) for name in self.names)
        return not any(path.is_relative_to(self.folder) for path in found if path)

    @cached_property
    def _below(self) -> dict[str, list[Path]]:
        found: dict[str, list[Path]] = defaultdict(list)
        beside = self.folder.name.casefold() in META
        for path in (self.folder.parent if beside else self.folder).rglob("*"):
            if path.suffix.lower() in (*TRACE_SUFFIXES, *IMAGE_SUFFIXES) and is_file(path):
                found[path.name].append(path)
                found[path.stem].append(path)
        return found


def _found(folder: Path, name: str) -> Path | None:
    """Return a file, whose name may have blanks around it, or be as of Windows or an address."""
    plain = name.strip()
    home = os.path.expanduser(plain)  # noqa: PTH111  (which raises no errors)
    address = unquote(plain.removeprefix("file://"))
    names = (name, plain, PureWindowsPath(plain).as_posix(), home, address)
    return next((path for each in names if is_file(path := folder / each)), None)


def _read_lines(path: Path) -> tuple[str, list[str], dict[str, dict[Any, Any]]]:
    """Return the separator, the names of the columns, and by their place the lines with content.

    Raises:
        UserError: If the file is missing or no CSV.
    """
    if not is_file(path):
        raise UserError(f"Manifest {path} does not exist; give an existing CSV in data.manifest.")
    try:
        if has_long_line(path):
            raise ValueError("it has a line of more than 1 MiB")
        stream = StringIO(read_utf8(path).decode(), newline="")
        begin, above, first = 0, 1, stream.readline()
        while first and (not first.strip() or first.casefold().startswith(("#", "sep="))):
            begin, above = stream.tell(), above + 1  # remarks, and what Excel writes
            first = stream.readline()
        delimiter = max(SEPARATORS, key=lambda mark: len({*_names([first], mark)} & {*KNOWN}))
        stream.seek(begin)
        names = _names(stream, delimiter)
        reader = csv.DictReader(stream, names, delimiter=delimiter, restval="")
        lines = {f"Manifest {path}, line {reader.line_num + above}": line for line in reader}
    except TableError as error:
        raise UserError(f"Manifest {path} {reason(error)}.") from error
    except (OSError, ValueError, csv.Error) as error:
        raise UserError(
            f"Manifest {path} is not a CSV file ({reason(error)}); save it as CSV."
        ) from error
    return delimiter, names, {place: line for place, line in lines.items() if any(line.values())}


def _check_names(path: Path, names: Sequence[str]) -> None:
    """Reject columns that nearly have a known name, or the same, and a manifest that lacks one.

    Raises:
        UserError: Naming the column.
    """
    for name in names:
        if (meant := _nearly(name)) is not None:
            raise UserError(
                f"Manifest {path} has a column {shorten(repr(name))}; call it {meant} if it is "
                f"meant, or otherwise if it is a condition of the recordings."
            )
    if twice := [name for name in KNOWN if names.count(name) > 1]:
        raise UserError(f"Manifest {path} has several columns {twice[0]}; keep one of them.")
    if missing := [column for column in NEEDED if column not in names]:
        if (wide := _wide(names)) and missing == ["path"]:
            raise UserError(
                f"Manifest {path} has a column of files {wide[0]!r} and none called path; write "
                f"{','.join(COLUMNS)}, a line for each file, and those made together as a group."
            )
        raise UserError(
            f"Manifest {path} has no column {' or '.join(missing)}; its first line must name "
            f"{','.join(COLUMNS)}, of which modality and group may be left out"
            + (SAMPLES if "path" in missing else "")
            + "."
        )


def _names(lines: Iterable[str], delimiter: str) -> list[str]:
    """Return the names of columns, with other words for path and label where these are absent."""
    names = [name.strip() for name in next(csv.reader(lines, delimiter=delimiter), ())]
    plain = [*map(_joined, names)]
    meant = {
        plain.index(found): known
        for known, others in MEANT.items()
        if known not in names and (found := next((o for o in others if o in plain), None))
    }
    labels = [at for at, name in enumerate(plain) if LABELS.fullmatch(name)]
    if len(labels) == 1 < len(names) and "label" not in (*names, *meant.values()):
        meant[labels[0]] = "label"
    files = [at for at, name in enumerate(plain) if FILES.fullmatch(name)]
    alone = len(files) == 1 and not {*_wide(names)} - {names[files[0]]}
    if alone and "path" not in (*names, *meant.values()):
        meant[files[0]] = "path"
    return [meant.get(at, name) for at, name in enumerate(names)]


def _wide(names: Sequence[str]) -> list[str]:
    """Return the columns that are called as a modality, which may name its files."""
    return [n for n in names if modality_named(n.casefold().split("_")[0]) in MODALITIES]


def _joined(name: str) -> str:
    return re.sub(r"[\W_]+", "", name.casefold())


def _fixed_folds(cells: Mapping[str, str]) -> tuple[list[int | None], tuple[str, ...]]:
    """Return the fold of every line of a manifest, and a note if they are renumbered.

    Args:
        cells: By line the cell of the column ``fold``, empty where there is none.

    Raises:
        UserError: If some lines have a fold and others none.
    """
    names = sorted({cell for cell in cells.values() if cell}, key=natural_key)
    if not names:
        return [None] * len(cells), ()
    if empty := [where for where, cell in cells.items() if not cell]:
        raise UserError(f"{empty[0]} has no fold; fill in the column fold everywhere or nowhere.")
    same = all(NUMBER.fullmatch(name) and int(name) == at for at, name in enumerate(names))
    note = ", ".join(f"{at} is {name}" for at, name in enumerate(names))
    notes = () if same else (f"The folds of the column fold are numbered from 0: {shorten(note)}.",)
    return [names.index(cell) for cell in cells.values()], notes


def write_manifest(recordings: Recordings, path: Path) -> None:
    """Write the table as CSV that :func:`read_manifest` reads back.

    Paths below the manifest's folder are written relative to it, so that both can move together.
    """
    folder = path.resolve().parent
    more = [PART] if any(row.part for row in recordings) else []
    more += [FOLD] if any(row.fold is not None for row in recordings) else []
    names = list(dict.fromkeys(name for row in recordings for name, _ in row.conditions))
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(map(to_cell, [*COLUMNS, RATE, *more, *names]))
        for row in recordings:
            rate = "" if row.sampling_rate is None else row.sampling_rate
            file = row.path.resolve()
            if file.is_relative_to(folder):
                file = file.relative_to(folder)
            part = write_part(row.part) if row.part else ""
            fold = "" if row.fold is None else row.fold
            optional = {PART: part, FOLD: fold, **dict(row.conditions)}
            values = [optional.get(name, "") for name in (*more, *names)]
            cells = [row.label, row.modality, str(file), row.group, rate, *values]
            writer.writerow(map(to_cell, cells))


def _read_line(files: _Files, where: str, line: dict[Any, Any], delimiter: str) -> Recording:
    """Return the recording of a line.

    Raises:
        UserError: Beginning with ``where``, if a cell cannot be understood.
    """
    if beyond := "".join(line.get(None, ())).strip():  # of csv.DictReader
        raise UserError(
            f"{where} has more cells than there are columns, {shorten(repr(beyond))}; put "
            f'"quotes" around a cell that has {delimiter!r} in it.'
        )
    cells = {name: from_cell(value) for name, value in line.items() if name}
    group, part, rate = (cells.get(name, "") for name in ("group", PART, RATE))
    path = resolved(files.find(cells["path"]))
    named = PureWindowsPath(cells["path"].strip())
    group = group if "group" in cells else named.as_posix().removesuffix(named.suffix)
    conditions = ((name, value) for name, value in cells.items() if value and name not in KNOWN)
    row = Recording(
        cells["label"],
        modality_named(cells.get("modality", modality_by_suffix(path)).strip()),
        path,
        int(group) if NUMBER.fullmatch(group.strip()) else group.strip(),
        _parsed(float, _plain_number(rate, delimiter)),
        tuple(conditions),
        _parsed(read_part, part),
    )
    check_row(row, where)  # what could not be parsed is text
    return row


def _plain_number(text: str, delimiter: str) -> str:
    """Return a number with a decimal point and no marks of thousands, as columns are divided."""
    mark = "." if delimiter == ";" else ","
    if re.fullmatch(rf"[1-9]\d{{0,2}}(\{mark}\d{{3}})+", text.strip()):
        return text.replace(mark, "")
    return text.replace(",", ".")


def _nearly(name: str) -> str | None:
    """Return the known column that a name may be a misspelling of; None if there is none."""
    plain = _joined(name)
    if name in KNOWN or not plain:
        return None
    if SAMPLING.fullmatch(plain):
        return RATE
    slips = {plain[:at] + plain[at : at + 2][::-1] + plain[at + 2 :] for at in range(len(plain))}
    return next((known for known in KNOWN if known in {*slips, plain.removesuffix("s")}), None)


def _parsed(parse: Callable[[str], Any], text: str) -> Any:  # noqa: ANN401
    try:
        return parse(text) if text else None
    except ValueError:
        return text
