"""Where the numbers of a table begin, how they are divided and written, and what stands above."""

import csv
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from tex_lightning_runtime.plain_text import (
    ARROW,
    HEAD,
    PAIR,
    has_arrows,
    pair_names,
    without_arrows,
    without_comments,
    without_names,
)
from tex_lightning_runtime.resampling import MAX_RATE, MIN_RATE
from tex_lightning_runtime.times import STAMP, UNITS, TableError

WORDS = {"stamp": "object", "text": "category"}  # as which pandas reads them
SAMPLE, SHOWN = 40, 400  # lines that the dialect is found in, letters of each
FOOTER = 10  # lines below the numbers
SEPARATORS = [",", ";", "\t", "|", " "]
NO_SEPARATOR = "\x1f"  # where there is one column
COMMENT = re.compile(r"[ \t]*(?:#|%|//)[#%/ \t]*")
SEP = re.compile(rb'"?sep=(.)"?[ \t]*\n', re.IGNORECASE)  # of Excel
MISSING = {
    "", "nan", "NaN", "null", "NULL", "none", "None", "na", "NA", "n/a", "N/A", "#N/A", "<NA>", "-",
    "--", "---",
}  # fmt: skip
NUMBER = re.compile(
    r"[-+]?(\d[\d.,'’ \u00a0\u202f]*|[.,]\d+)([eE][-+]?\d+)?|[-+]?inf(inity)?", re.I
)
QUANTITY = re.compile(rf"({NUMBER.pattern})\s*(?P<unit>[^\W\d_][^\d\s,;]{{0,5}}\d?|%|°\w?)", re.I)
WHOLE = re.compile(r"[-+]?\d+")
ZERO_FIRST = re.compile(r"[-+]?0\d+|[-+]0")
THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+")
POINTS = re.compile(r"[-+]?[1-9]\d{0,2}(\.\d{3})+")
AMOUNT = r"[\"']?[ \t:=,;]+[\"']?(?P<value>\d[\d.,]*(?:e[-+]?\d+)?)[\"']?[ \t,;(]*"
RATE = re.compile(
    r"(?:\bfs|\bsamp\w*[ _-]?(?:rate|freq\w*)|\babtast(?:rate|frequenz)|^\W*(?:rate|frequency))"
    rf"(?:[ ]*[(\[](?P<before>\w+/?\w*)[)\]])?{AMOUNT}(?P<unit>k?hz|ks/s|k?sps|s/s)?",
    re.IGNORECASE,
)
PERIOD = re.compile(
    r"(?:\bsampl\w*[ _-]?(?:interval|period|time)|\bdelta_?x|\bdt)"
    rf"(?:[ ]*[(\[](?P<before>[µμ\w]+)[)\]])?{AMOUNT}(?P<unit>[mµμun]?s\b)?",
    re.IGNORECASE,
)
UNIT = re.compile(  # in a row of units
    r"[(\[].*[)\]]|[mµμukM]?(V|A|g|N|Pa|Hz|T|G|W|K|s|m|ohm)|[cm]m|ns|sec|min|%|-|raw|a\.?u\.?|volts?"
    r"|°\w*|((µ|μ|u|m|k|c)?(m|g|rad|deg|°)|dps|rpm|counts?|lsb|bits?|adc|digits?|seconds?)"
    r"([/*]s(ec)?(\^?-?2|²|/s)?)?|sequence|gauss|tesla",
)


@dataclass(frozen=True)
class Layout:
    """How a table is written.

    Attributes:
        separator: Of columns; a blank stands for any white space.
        quote: Around cells.
        decimal: Point or comma.
        thousands: Mark between digits, if there is one.
        names: Of the columns; None if there are none.
        units: Of the columns, or none.
        words: Types of the columns of dates, clock times and text, as pandas takes them.
        rate: Rate in Hz that stands above the numbers, if one does.
        first_line: Number of the line in the file that the numbers begin in.
        notes: What was skipped.
    """

    separator: str
    quote: str = '"'
    decimal: str = "."
    thousands: str | None = None
    names: tuple[str, ...] | None = None
    units: tuple[str, ...] = ()
    words: Mapping[int, str] = field(default_factory=dict)
    rate: float | None = None
    first_line: int = 1
    notes: tuple[str, ...] = ()

    @property
    def pandas_separator(self) -> str:
        """The separator as pandas takes it."""
        return r"\s+" if self.separator == " " else self.separator

    def cells(self, line: str) -> list[str]:
        """Divide a line."""
        return _split(line, self.separator, self.quote)


def mismatch(names: int, columns: int) -> TableError:
    """Return the error for a line of more or fewer names than there are columns."""
    return TableError(
        f"has {names} names and {columns} columns; give every column a name, and put # before "
        "lines that are no names"
    )


def find_layout(content: bytes) -> tuple[bytes, Layout]:
    """Return the lines of numbers and how they are written.

    Args:
        content: Plain text.

    Raises:
        TableError: If there are no numbers, or what they mean is in doubt.
    """
    excel = SEP.match(content)
    given = excel[1].decode() if excel else None
    content = content[excel.end() :] if excel else content
    content, names, separator, quote = _undecorated(content, given)
    lines = [line.decode(errors="replace") for line in _sample(content)]
    found = Layout(separator, quote)
    rows = [found.cells(line) for line in lines]
    width = Counter(map(len, rows)).most_common(1)[0][0]
    columns = Kinds([row for row in rows if len(row) == width])
    head = content[:HEAD].decode(errors="replace").split("\n")
    start = next((n for n, line in enumerate(head) if columns.fit(found.cells(line))), len(head))
    if not columns.numeric or start == len(head):
        raise TableError("holds no numbers in columns; give one sample a line")
    if _undivided(columns, head, start, separator):
        found = Layout(NO_SEPARATOR, quote, ",")
        columns = Kinds([found.cells(line) for line in lines])
    return _with_heading(content, found, columns, head, start, names)


def _undecorated(content: bytes, given: str | None) -> tuple[bytes, list[str], str, str]:
    """Take arrows of monitors and names before numbers away, and find separator and quotes."""
    sample = _sample(content)
    arrows = has_arrows(sample)
    if arrows:
        sample = [ARROW.sub(b"", line) for line in sample]
    if names := pair_names(sample):
        sample = [without_names(line, []) for line in sample]
    separator, quote = _dialect([line.decode(errors="replace") for line in sample], given)
    if arrows:
        separator = ";" if separator == NO_SEPARATOR else separator
        content = without_arrows(content, separator.encode())
    if names:
        lines = content[:HEAD].split(b"\n")
        first = [n.encode() for n in names]
        begin = next((n for n, line in enumerate(lines) if PAIR.findall(line) == first), 0)
        place = sum(len(line) + 1 for line in lines[:begin])
        content = content[:place] + without_names(content[place:], names)
        names = ["time", *names] if arrows else names
    return content, names, separator, quote


def _sample(content: bytes) -> list[bytes]:
    """Return whole lines from the second half, where numbers stand; comments are none."""
    if len(content) > 2 * HEAD:
        half = len(content) // 2
        middle = content[half : half + HEAD // 8]
        lines = middle.split(b"\n")[1:-1] or [middle]
    else:
        lines = content.split(b"\n")
    plain = [line for line in lines if line.strip(b" \t,;") and line.lstrip()[:1] not in b"#%"]
    plain = [line for line in plain if not line.lstrip().startswith(b"//")]
    if not plain:
        raise TableError("holds no numbers; give one sample a line")
    kept = plain[:-1] if len(plain) > 2 else plain  # the last may be cut
    return kept[(len(kept) - 1) // 2 :][:SAMPLE]


def _dialect(lines: list[str], given: str | None) -> tuple[str, str]:
    """Find separator and quotes in lines of numbers."""
    import clevercsv

    text = "\n".join(line.strip(" ")[:SHOWN] for line in lines)
    found = clevercsv.Detector().detect(text, delimiters=SEPARATORS)
    separator, quote = (found.delimiter, found.quotechar) if found else ("", "")
    if given:
        separator = given
    elif separator == "," and all(_are_decimal_commas(line) for line in lines):
        separator = " "
    return separator or NO_SEPARATOR, quote or '"'


def _are_decimal_commas(line: str) -> bool:
    cells = line.split()
    return len(cells) > 1 and all(re.fullmatch(r"[-+]?\d+,\d+(e[-+]?\d+)?", c, re.I) for c in cells)


def _split(line: str, separator: str, quote: str = '"') -> list[str]:
    if separator == " ":
        return line.replace(quote, "").split()
    if separator == NO_SEPARATOR:
        return [line.strip().strip(quote)]
    reader = csv.reader([line], delimiter=separator, quotechar=quote, skipinitialspace=True)
    return [cell.strip() for cell in next(reader, [])]


def kind(cell: str) -> str:
    """Return what a cell holds: nothing, a number, a date or clock time, or text."""
    if cell in MISSING:
        return ""
    if STAMP.fullmatch(cell):
        return "stamp"
    return "number" if NUMBER.fullmatch(cell) or QUANTITY.fullmatch(cell) else "text"


class Kinds:
    """What the columns of a table hold, by some of its rows."""

    def __init__(self, rows: Sequence[Sequence[str]]) -> None:
        self.rows = rows
        counts = [Counter(map(kind, column)) for column in zip(*rows, strict=True)]
        self.kinds = [self._usual(count) for count in counts]
        self.count = next((n for n in range(len(counts), 0, -1) if self.kinds[n - 1]), 0)

    @staticmethod
    def _usual(count: Counter[str]) -> str:
        for name in ("number", "stamp", "text"):
            if count[name] and count[name] >= 0.5 * (count.total() - count[""]):
                return name
        return "text" if count.total() > count[""] else ""

    @property
    def numeric(self) -> bool:
        """Whether any column holds numbers."""
        return "number" in self.kinds

    def fit(self, cells: Sequence[str]) -> bool:
        """Return whether cells are a whole row of the table."""
        if not self.count <= len(cells) <= len(self.kinds):
            return False
        found = [kind(cell) for cell in cells]
        pairs = [*zip(found, self.kinds, strict=False)]
        whole = all(one in ("", other) for one, other in pairs if other in ("number", "stamp"))
        return whole and any(one == other == "number" for one, other in pairs)


def _with_heading(
    content: bytes, found: Layout, columns: Kinds, head: list[str], start: int, names: list[str]
) -> tuple[bytes, Layout]:
    """Read what stands above and below the numbers, and how these are written."""
    above = [line for line in head[:start] if line.strip(" \t,;")]
    notes: list[str] = []
    heading, rate = ([names], None) if names else _heading(above, found, columns, notes)
    rate = rate or next(filter(None, map(_stated_rate, above)), None)
    if names and above and re.search(r"[:=]\s*[-+.\d]", above[-1]) and not rate:
        notes.append(f"an incomplete line of numbers is left out: {above[-1].strip()[:40]!r}")
    first = found.cells(head[start])
    if not heading and _is_numbering(first, columns.rows):
        heading, start = [first], start + 1
    elif not heading and _is_rate(first, columns.rows):
        rate, start = float(first[0]), start + 1
    place = len("\n".join(head[:start]).encode()) + (start > 0)
    data, below = _without_footer(content[place:], found, columns)
    numbers = [cell for row in columns.rows for cell in row if kind(cell) == "number"]
    decimal, thousands = _decimal(numbers)
    named, units = _names(heading)
    if named and any(line.startswith("X_Dimension\tTime") for line in above):  # of LabVIEW
        named = tuple("time" if name == "X_Value" else name for name in named)
    return without_comments(data), replace(
        found, decimal=decimal, thousands=thousands, names=named, units=units, rate=rate,
        words={n: WORDS[each] for n, each in enumerate(columns.kinds) if each in WORDS},
        first_line=start + 1, notes=(*notes, *below),
    )  # fmt: skip


def _heading(
    above: list[str], found: Layout, columns: Kinds, notes: list[str]
) -> tuple[list[list[str]], float | None]:
    """Return the lines of names and units directly above the numbers, the last one first."""
    rows: list[list[str]] = []
    for line in reversed(above):
        commented, plain = bool(COMMENT.match(line)), COMMENT.sub("", line, count=1)
        cells = _as_many(plain, found, columns.count)
        if len(cells) == columns.count and any(kind(c) == "text" for c in cells):
            stated = _stated_rate(line) and not rows
            if not stated and all(
                kind(c) != "stamp" and not re.search(r"\d[.,]\d", c) for c in cells
            ):
                rows.append(cells)
                continue
        if rows:
            break
        if commented:
            continue
        numbers = [kind(cell) in ("number", "stamp") for cell in cells]
        if all(numbers) and len(cells) == 1 and columns.count > 1:
            return [], _lone_rate(cells[0], notes)
        if all(numbers):
            notes.append(f"an incomplete line of numbers is left out: {line.strip()[:40]!r}")
        elif len(cells) > 1 and not any(numbers) and not _stated_rate(line):
            raise mismatch(len(cells), columns.count)
        break
    return rows, None


def _as_many(line: str, found: Layout, count: int) -> list[str]:
    """Divide a line of names, which may be divided otherwise than the numbers."""
    best: list[str] = []
    if count == 1:  # a blank may stand in a name, and a unit behind a comma
        return [part for part in re.split(r"[;\t]|,(?! )", line.strip()) if part]
    for separator in (found.separator, ",", ";", "\t", " "):
        cells = _split(line, separator, found.quote)
        while len(cells) > count and cells[-1].casefold() in ("", "comment"):
            cells.pop()
        best = best or cells
        if len(cells) == count:
            return cells
    return best


def _names(heading: list[list[str]]) -> tuple[tuple[str, ...] | None, tuple[str, ...]]:
    """Return names and units out of lines of them, the last one first."""
    if not heading:
        return None, ()
    units: tuple[str, ...] = ()
    if len(heading) > 1 and all(UNIT.fullmatch(cell) for cell in heading[0] if cell):
        units, heading = tuple(heading[0]), heading[1:]
    names = list(heading[0])
    if len(heading) > 1 and len({*names}) < len(names):  # several levels, as pandas writes them
        names = [f"{a} {b}".strip() for a, b in zip(heading[1], names, strict=True)]
    return tuple(names), units


def _is_numbering(first: list[str], rows: Sequence[Sequence[str]]) -> bool:
    """Return whether a line numbers the columns, 0,1,2, as pandas names them."""
    named = first[1:] if first and not first[0] else first
    if named == [*map(str, range(len(named)))] and named:
        return len(named) > 2 or _are_fractions(rows)
    return (
        len(named) > 1 and named == [*map(str, range(1, len(named) + 1))] and _are_fractions(rows)
    )


def _are_fractions(rows: Sequence[Sequence[str]]) -> bool:
    return all(re.search(r"[.,e]", cell, re.IGNORECASE) for row in rows for cell in row[-1:])


def _is_rate(first: list[str], rows: Sequence[Sequence[str]]) -> bool:
    """Return whether a whole number above one column of fractions is far beyond them."""
    if len(first) != 1 or not WHOLE.fullmatch(first[0]) or not _are_fractions(rows):
        return False
    largest = max(abs(float(row[0].replace(",", "."))) for row in rows if kind(row[0]) == "number")
    return MIN_RATE <= float(first[0]) <= MAX_RATE and float(first[0]) > 10 * largest


def _lone_rate(cell: str, notes: list[str]) -> float | None:
    """Return a number that stands alone above the table, if it can be a rate."""
    value = _amount(cell)
    if value is not None and MIN_RATE <= value <= MAX_RATE:
        return value
    notes.append(f"the line {cell!r} above the numbers is left out")
    return None


def _stated_rate(line: str) -> float | None:
    """Return the rate in Hz that a line states, if it does."""
    if (found := RATE.search(line)) and (value := _amount(found["value"])):
        unit = (found["unit"] or found["before"] or "").casefold()
        return value * (1000 if unit.startswith("k") else 1)
    if (found := PERIOD.search(line)) and (value := _amount(found["value"])):
        unit = (found["unit"] or found["before"] or "s").replace("µ", "μ").casefold()
        return 1 / (value * UNITS[unit]) if unit in UNITS else None
    return None


def _amount(text: str) -> float | None:
    plain = text.replace(",", "") if THOUSANDS.fullmatch(text) else text.replace(",", ".")
    try:
        return float(plain.rstrip("."))
    except ValueError:
        return None


def _without_footer(content: bytes, found: Layout, columns: Kinds) -> tuple[bytes, list[str]]:
    """Drop lines below the numbers, and a last one that is not whole."""
    notes: list[str] = []
    for _ in range(FOOTER):
        whole = content.endswith(b"\n")
        content = content.rstrip(b"\n \t")
        begin = content.rfind(b"\n") + 1
        line = content[begin:].decode(errors="replace")
        cells = found.cells(line)
        cut = not whole and not notes and cells and not re.search(r"[\d\w\"]$", cells[-1])
        if columns.fit(cells) and not (cut and columns.kinds[len(cells) - 1] == "number"):
            break
        content = content[:begin]
        if line.strip(" \t,;") and not COMMENT.match(line):
            notes.append(f"the last line is no whole row and is left out: {line.strip()[:40]!r}")
    return content + b"\n", notes


def _undivided(columns: Kinds, head: list[str], start: int, separator: str) -> bool:
    """Return whether the commas between two whole numbers are decimal commas of one column.

    Raises:
        TableError: If that is in doubt.
    """
    cells = [cell for row in columns.rows for cell in row if cell not in MISSING]
    whole = separator == "," and all(WHOLE.fullmatch(cell) for cell in cells)
    if not whole or any(row[1][:1] in ("", "-", "+") for row in columns.rows if len(row) > 1):
        return False
    zeros = any(map(ZERO_FIRST.fullmatch, cells))
    above = [line for line in head[:start] if line.strip() and not COMMENT.match(line)]
    if len(columns.kinds) == 2 and above and "," not in above[-1]:
        return _stated_rate(above[-1]) is None and kind(above[-1].strip()) == "text"
    if above:
        return False
    if len(columns.kinds) == 2 and zeros:
        return True
    if len(columns.kinds) == 2 or (zeros and len(columns.kinds) % 2 == 0):
        raise TableError(
            "has decimal commas or columns of whole numbers, which cannot be told apart: write "
            "decimal points, or a line of names"
        )
    return False


def _decimal(cells: Sequence[str]) -> tuple[str, str | None]:
    """Return the decimal mark and that of thousands, if there is one."""
    commas = [cell for cell in cells if "," in cell]
    if both := [cell for cell in commas if "." in cell]:
        return (",", ".") if both[0].rindex(",") > both[0].rindex(".") else (".", ",")
    if not commas:
        points = any(POINTS.fullmatch(cell) and cell.count(".") > 1 for cell in cells)
        return (",", ".") if points else (".", None)
    grouped = all(map(THOUSANDS.fullmatch, commas))
    small = [cell for cell in cells if cell not in commas]
    if any(cell.count(",") > 1 for cell in commas) or (
        grouped
        and small
        and all(len(re.split(r"[.e]", cell)[0].lstrip("+-")) < 4 for cell in small)
    ):
        return ".", ","
    return ",", None
