"""What stands above and below the numbers of a table: names, units, a rate, remarks."""

import re
from collections.abc import Sequence
from itertools import takewhile

from tex_lightning_runtime.cells import NUMBER, WHOLE, Dialect, Kinds, kind
from tex_lightning_runtime.column import TIMES, UNNAMED, plain_unit, split_words
from tex_lightning_runtime.errors import inflected
from tex_lightning_runtime.resampling import MAX_RATE, MIN_RATE
from tex_lightning_runtime.stated_rates import amount, lone_rate, stated_rate
from tex_lightning_runtime.times import EPOCH, UNITS, TableError

FOOTER, LONGEST = 10, 50  # lines below the numbers: told one by one, and at most
FACTOR = re.compile(r"\d(?:\.\d+)?e[-+]?\d+ \*", re.IGNORECASE)  # of MATLAB
COMMENT = re.compile(r"^[ \t]*(?:(?:#|%|//)[#%/ \t]*|[-=~*]{3,} +(?=\w))")
SAMPLES = re.compile(
    r"\b(?:npts|samples|points)[\"' \t:=,;]+(\d+)\b|\b(\d+) samples\b(?! ?(?:/|per))", re.I
)
UNIT = re.compile(  # in a row of units
    r"[(\[].*[)\]]|[mµμukM]?(V|A|g|N([·*⋅. ]?[cm]?m)?|Pa|Hz|T|G|W|K|s|m|ohm)|[cm]m|ns"
    r"|%|-|raw|a\.?u\.?|volts?"
    r"|°\w*|((µ|μ|u|m|k|c)?(m|g|rad|deg|°)|dps|rpm|counts?|lsb|bits?|adc|digits?|[Ss]econds?)"
    r"([/*]\(?s(ec)?(\^?-?2|²|/s)?\)?)?|[Ss]equence|Volts?|gauss|tesla"
    rf"|(?i:{'|'.join(unit for unit in UNITS if len(unit) > 1)})",
)
UNNUMBERED = re.compile(rf"{UNNAMED.pattern}|[(\[].{{0,80}}?[)\]]")  # X (1.5 g)
FRACTION = re.compile(r"\b\d+[.,]\d+")
JSON_NAMES = re.compile(r'"columns?": *\[([^\]]{0,4000})\]')  # as OpenSignals has them
TITLED = re.compile(r"\S \S+: \S")  # Title 1: Time
STATEMENT = re.compile(r"[^=]+=\s*[-+]?[\d.].*")  # between names


def read_heading(
    above: list[str], dialect: Dialect, columns: Kinds, notes: list[str], *, listed: bool
) -> tuple[list[list[str]], float | None]:
    """Return the lines of names and units above the numbers, the last one first, or else a rate.

    Remarks and lines without content may stand between them and the numbers. ``listed`` says that
    these are titles with one value each, which are no names.
    """
    rows: list[list[str]] = []
    cut = [*takewhile(lambda line: _is_part(line, dialect), reversed(above))]
    if cut:
        many = inflected(
            len(cut), "incomplete line of numbers is", "incomplete lines of numbers are"
        )
        notes.append(f"{many} left out: {cut[-1].strip()[:40]!r}")
    for line in reversed(above[: len(above) - len(cut)]):
        commented, plain = bool(COMMENT.match(line)), COMMENT.sub("", line, count=1)
        cells = _as_many(plain, dialect, columns)
        whole = dialect.cells(line) if dialect.separator != " " or columns.numbered else []
        if commented and len(cells) < columns.count == len(whole):  # # is a name
            cells = whole
        listed_pair = listed and len(cells) == 2
        if (
            not listed_pair
            and _are_names(cells, columns)
            and (rows or not stated_rate([",".join(cells)]))
        ):
            rows.append(cells)
        elif rows:
            break
        elif not commented and any(map(kind, cells)):
            return [], _read_other(line, cells, columns, notes, listed=listed)
        elif not commented:
            notes.append(f"a line without numbers is left out: {line.strip()[:40]!r}")
    return rows, None


def _is_part(line: str, dialect: Dialect) -> bool:
    """Return whether a line holds several numbers and nothing else, and states no rate."""
    found = [*filter(None, map(kind, dialect.cells(line)))]
    return len(found) > 1 and "text" not in found and not stated_rate([line])


def _are_names(cells: Sequence[str], columns: Kinds) -> bool:
    """Return whether cells are as many as columns, some of them text and none a measurement."""
    kinds = [*map(kind, cells)]
    plain = [UNNUMBERED.sub("", cell.casefold()) for cell in cells[: columns.count]]
    found = [each for each in map(FRACTION.search, plain) if each]
    begins = {each.string[: each.end()] for each in found}  # imu-1.5:x, imu-1.5:y
    rests = {each.string.replace(each[0], "") for each in found}  # ch 1.1, ch 1.2
    device = len(begins) == 1 and min(begins)[0].isalpha()
    plain_ones = any(NUMBER.fullmatch(each.string) for each in found)
    numbered = len(found) > 1 and not plain_ones and (device or len(rests) == 1)
    return (
        len(cells) in (columns.count, len(columns.kinds))
        and not _are_settings(cells)
        and "text" in kinds
        and "stamp" not in kinds
        and (not found or numbered)
        and not _are_values(cells, columns)
    )


def _are_values(cells: Sequence[str], columns: Kinds) -> bool:
    """Return whether whole numbers beside text are as those below, and do not count columns."""
    numbers = {n: int(cell) for n, cell in enumerate(cells) if WHOLE.fullmatch(cell)}
    for n, number in numbers.items() if len(cells) == len(columns.kinds) else ():
        below = [int(row[n]) for row in columns.rows if WHOLE.fullmatch(row[n])]
        if len(below) == len(columns.rows) and min(below) <= number <= max(below):
            return [*numbers.values()] not in ([*range(k, len(numbers) + k)] for k in (0, 1))
    return False


def _are_settings(cells: Sequence[str]) -> bool:
    """Return whether cells are a title and its values, or a title alone, or x = 1."""
    titles = [cell.endswith((":", "=")) for cell in cells if cell]
    return "=" in cells or (any(titles[:1]) and (not all(titles) or len(titles) == 1))


def _read_other(
    line: str, cells: Sequence[str], columns: Kinds, notes: list[str], *, listed: bool
) -> float | None:
    """Return the rate in Hz that a line with content, but without names, may be.

    Raises:
        TableError: If it is names, and not as many as there are columns.
    """
    numbers = [kind(cell) in ("number", "stamp") for cell in cells]
    if all(numbers) and len(cells) == 1 and columns.count > 1:
        return lone_rate(cells[0], columns.rows, notes)
    if stated_rate([line]) or _are_settings(cells):
        return None  # which is read with the other lines above
    if listed:
        notes.append(f"a line without names is left out: {line.strip()[:40]!r}")
    elif sum(numbers) > 0.5 * len(cells) or (any(numbers) and len(cells) == columns.count):
        notes.append(f"an incomplete line of numbers is left out: {line.strip()[:40]!r}")
    elif len(cells) > 1 and not any(numbers):
        raise mismatch(len(cells), columns.count, line)
    return None


def with_statements(above: list[str], dialect: Dialect, count: int) -> list[str]:
    """Make lines of their own of names that stand beside those of columns, above a number each."""
    if len(above) < 2:
        return above
    names, values = (dialect.cells(line.rstrip(dialect.separator)) for line in above[-2:])
    beside = [*zip(names, values, strict=False)][count:]
    constant = all(kind(name) == "text" and kind(value) == "number" for name, value in beside)
    named = len(names) == len(values) and all(kind(cell) == "text" for cell in values[:count])
    if not (beside and constant and named):
        return above
    lines = [dialect.separator.join(cells[:count]) for cells in (names, values)]
    return [*above[:-2], *(f"{name}: {value}" for name, value in beside), *lines]


def _as_many(line: str, dialect: Dialect, columns: Kinds) -> list[str]:
    """Divide a line of names, which may be divided otherwise than the numbers."""
    best = [name for names in JSON_NAMES.findall(line) for name in re.findall('"(.*?)"', names)]
    count = columns.count
    if best or count == 1:  # a blank may stand in a name, and a unit behind a comma
        return best or [part for part in re.split(r"[;\t]|,(?! )", line.strip()) if part]
    for separator in (dialect.separator, "  ", ",", ";", "\t", " "):
        if separator != dialect.separator and TITLED.search(line):
            continue
        whole = re.sub(r" (?=[(\[])", "", line) if separator == " " else line  # t [s] x [g]
        cells = Dialect(separator, dialect.quote).cells(whole)
        while len(cells) > count and (
            STATEMENT.fullmatch(cells[-1])
            or (len(cells) != len(columns.kinds) and cells[-1].casefold() in ("", "comment"))
        ):
            cells.pop()
        more = len(cells) == count + 1
        titled = cells and (cells[0].endswith((":", "=")) or cells[0] == "Headers")
        if more and titled and "number" not in map(kind, cells):  # Fields: x y
            cells = cells[1:]
        alike = separator == dialect.separator and columns.numbered
        if alike and 1 < len(cells) == count - 1 and {*map(kind, cells)} == {"text"}:
            cells = ["", *cells]  # R does not name its numbers of rows
        best = best or cells
        if len(cells) in (count, len(columns.kinds)):
            return cells
    return best


def names_and_units(heading: list[list[str]]) -> tuple[tuple[str, ...] | None, tuple[str, ...]]:
    """Return names and units out of lines of them, the last one first."""
    if not heading:
        return None, ()
    units: tuple[str, ...] = ()
    index, *others = heading[0]
    if len(heading) > 1 and TIMES & {*split_words(index)} and not any(others):
        heading = [[index, *heading[1][1:]], *heading[2:]]  # as pandas names an index
    while len(heading) > 1 and _are_units(heading, bool(units)):
        found = tuple(heading[0]) if any(map(UNIT.fullmatch, heading[0])) else ()
        units, heading = units or found, heading[1:]
    names = list(heading[0])
    for level in heading[1:]:  # several, as pandas writes them
        if sum(map(bool, level)) > 1 and not _differ(names):
            names = [f"{a} {b}".strip() for a, b in zip(level, names, strict=True)]
    return tuple(names), units


def _are_units(heading: list[list[str]], known: bool) -> bool:
    """Return whether the last line holds units, or types such as f8 or remarks, below names."""
    cells, names = heading[0], [line for line in heading[1:] if all(line) and _differ(line)]
    short = len("".join(cells)) < 4 * len(cells) or len({*cells}) == 1 < len(cells)
    pairs = (each for line in names for each in zip(line, cells, strict=False))
    below = [name for name, cell in pairs if not cell or plain_unit(cell) in UNITS]
    remarks = any(TIMES & {*split_words(name)} for name in below)
    types = bool(names) and short and not _differ(cells)
    return types or remarks or not (known or any(c and not UNIT.fullmatch(c) for c in cells))


def _differ(cells: Sequence[str]) -> bool:
    return len({*cells}) == len(cells)


def is_numbering(first: list[str], rows: Sequence[Sequence[str]]) -> bool:
    """Return whether a line numbers the columns, 0,1,2, as pandas names them."""
    named = first[1:] if first and not first[0] else first
    numbers = [*map(str, range(len(named) + 1))]
    if named == numbers[:-1] and len(named) > 2:
        return True
    return named in (numbers[:-1], numbers[1:] * (len(named) > 1)) and _are_fractions(rows)


def _are_fractions(rows: Sequence[Sequence[str]]) -> bool:
    return all(re.search(r"[.,e]", cell, re.IGNORECASE) for row in rows for cell in row[-1:])


def is_beginning(first: list[str], rows: Sequence[Sequence[str]]) -> bool:
    """Return whether a line has one moment since 1970 above every column of other numbers."""
    last, moments = [*map(amount, rows[-1])], {*map(amount, first)}
    return len(moments) == 1 and all(
        now is not None and then is not None and EPOCH[0] < then < EPOCH[1] and now < EPOCH[0]
        for now in last for then in moments
    )  # fmt: skip


def is_beyond(first: list[str], rows: Sequence[Sequence[str]]) -> bool:
    """Return whether a whole number above one column of fractions is far beyond them."""
    if len(first) != 1 or not WHOLE.fullmatch(first[0]) or not _are_fractions(rows):
        return False
    largest = max(abs(float(row[0].replace(",", "."))) for row in rows if kind(row[0]) == "number")
    return MIN_RATE <= float(first[0]) <= MAX_RATE and float(first[0]) > 10 * largest


def without_footer(content: bytes, dialect: Dialect, columns: Kinds) -> tuple[bytes, list[str]]:
    """Drop lines below the numbers, and a last one that is not whole."""
    left: list[str] = []
    for _ in range(LONGEST):
        whole = content.endswith(b"\n")
        content = content.rstrip(b"\n \t")
        begin = content.rfind(b"\n") + 1
        line = content[begin:].decode(errors="replace")
        cells = dialect.cells(line)
        cut = not whole and not left and cells and not re.search(r"[\d\w\"]$", cells[-1])
        if columns.fit(cells) and not (cut and columns.kinds[len(cells) - 1] == "number"):
            break
        content = content[:begin]
        if line.strip(" \t,;") and not COMMENT.match(line):
            left.append(f"{line.strip()[:40]!r}")
    told = "the last line is no whole row and is left out: "
    if len(left) > FOOTER:
        left, told = left[-1:], f"{len(left)} lines below the numbers are left out, the first is "
    return content + b"\n", [told + line for line in left]


def mismatch(names: int, columns: int, line: str = "") -> TableError:
    """Return the error for a ``line`` of more or fewer names than columns, or with fractions."""
    if names == columns:
        said = "has a line above the numbers that may be names or settings: write names without"
        return TableError(f"{said} fractions, and put # before lines that are no names")
    read = f" ({line.strip()[:40]!r} is read as names)" if line else ""
    return TableError(
        f"has {names} names and {columns} columns; give every column a name, and put # before "
        f"lines that are no names{read}"
    )
