"""Where the numbers of a table begin, how they are divided and written, and what stands above."""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

from tex_lightning_runtime.cells import (
    MISSING,
    NO_SEPARATOR,
    VECTOR,
    WHOLE,
    Dialect,
    Kinds,
    decimal_mark,
    kind,
)
from tex_lightning_runtime.column import TIMES, split_words
from tex_lightning_runtime.errors import inflected
from tex_lightning_runtime.heading import (
    COMMENT,
    FACTOR,
    FOOTER,
    SAMPLES,
    UNIT,
    is_beginning,
    is_beyond,
    is_numbering,
    names_and_units,
    read_heading,
    with_statements,
    without_footer,
)
from tex_lightning_runtime.plain_text import (
    ARROW,
    HEAD,
    PAIR,
    STAMPED,
    UPTIME,
    WRAPPED,
    most,
    pair_names,
    without_comments,
    without_names,
    word_before,
)
from tex_lightning_runtime.stated_rates import lone_rate, rate_doubts, stated_rate
from tex_lightning_runtime.times import TableError

WORDS = {"stamp": "object", "text": "category"}  # as which pandas reads them
SAMPLE, SHOWN = 40, 400  # lines that the dialect is found in, letters of each
SEPARATORS = [",", ";", "\t", "|", " "]
SEP = re.compile(rb'"?sep=(.)"?[ \t]*\n', re.IGNORECASE)  # of Excel
UNIT_BEHIND = re.compile(rf"(?<=\d) +(?:{UNIT.pattern})(?=[ ]*(?:[,;\t|]|$))")  # of a number
KEYS = re.compile(r"(?m)(?:^[A-Z]+(?:_[A-Z]+)+\b.*\n?){3}\Z")  # MARKER_NAMES
VALUES = re.compile(r"(?:.*_)?(?:data|values?)\W*", re.IGNORECASE)  # a title of rows
VECTORS = re.compile(  # in a line, without quotes
    rf"(?m)(^|,) *({VECTOR.pattern}) *(?=,|$)".replace(r"\s", " ").encode()
)
BEHIND = rb"(?m)^([^#\n]*?[\d.][\"]?)%b *(#(?!N/A|NV\b|[A-Z/0]+[!?])[^\n]*)"  # a row, a remark
BITS = re.compile(r"[01]{4,32}")
COMMAS = re.compile(  # decimal ones, two at least
    r"\s*(?=(?:[^,]*\d,\d){2})(?:[-+]?\d+(?:,\d+)?(?:e[-+]?\d+)?(?:\s+|$)){2,}(?:[A-Za-z]\w*\s*)?",
    re.I,
)
MIXED = re.compile(r"(?=.*\t).*?\.\d+ +[-+]?\d*\.\d")  # a tab, and blanks between numbers
RULE = "-+=|,;: \t"  # of which lines between others consist
EMPTY = re.compile(rb"\n\n+")  # lines
ZERO_FIRST = re.compile(r"[-+]?0\d+|[-+]0")


@dataclass(frozen=True)
class Layout:
    """How a table is written."""

    dialect: Dialect
    decimal: str
    thousands: str | None  # mark between digits
    names: tuple[str, ...] | None
    units: tuple[str, ...]  # of the columns, or none
    words: Mapping[int, str]  # types of the columns of dates and text, as pandas takes them
    rate: float | None  # in Hz, that stands above the numbers
    count: int | None  # of samples, that stands above them
    first_line: int  # number of the line in the file that they begin in
    again: str  # a remark above them that stands between them, too
    notes: tuple[str, ...]  # what was skipped


def find_layout(content: bytes) -> tuple[bytes, Layout]:
    """Return the lines of numbers and how they are written.

    Raises:
        TableError: If there are no numbers, or what they mean is in doubt.
    """
    excel = SEP.match(content)
    given = excel[1].decode() if excel else None
    content = content[excel.end() :] if excel else content
    content, names, dialect = _undecorated(content, given)
    lines = [line.decode(errors="replace") for line in _sample(content)]
    rows = [dialect.cells(line) for line in lines]
    width = Counter(map(len, rows)).most_common(1)[0][0]
    columns = Kinds([row for row in rows if len(row) == width])
    content, notes = _without_remarks(content, dialect, columns)
    head = content[:HEAD].decode(errors="replace").split("\n")
    first = _first_row(columns, dialect, head)
    start = _below_titles(columns, dialect, head, first)
    if "number" not in columns.kinds or start == len(head):
        raise TableError("holds no numbers in columns; give one sample a line")
    if _undivided(columns, head, start, dialect.separator):
        dialect = Dialect(NO_SEPARATOR, dialect.quote)
        columns = Kinds([dialect.cells(line) for line in lines])
    content, layout = _with_heading(content, dialect, columns, head, start, names)
    if start > first:
        notes.append(f"the numbers above {head[start - 1].strip()[:40]!r} are left out")
    return content, replace(layout, notes=(*notes, *layout.notes))


def _without_remarks(content: bytes, dialect: Dialect, columns: Kinds) -> tuple[bytes, list[str]]:
    """Drop remarks in a cell of their own behind whole rows, and say so."""
    mark, left = dialect.separator.encode(), list[str]()
    usual = any(cell.startswith("#") for row in columns.rows for cell in row)
    blanks = mark.isspace() and mark != b"\t"
    if usual or blanks or not any(mark + each in content for each in (b"#", b" #")):
        return content, []

    def shortened(found: re.Match[bytes]) -> bytes:
        if not columns.fit(dialect.cells(found[1].decode(errors="replace"))):
            return found[0]
        left.append(found[2].decode(errors="replace"))
        return found[1]

    content = re.sub(BEHIND % re.escape(mark), shortened, content)
    many = inflected(len(left), "remark behind numbers is", "remarks behind numbers are")
    return content, [f"{many} left out: {left[0][:40]!r}"] if left else []


def _first_row(columns: Kinds, dialect: Dialect, head: list[str]) -> int:
    """Return the place of the first whole row, or of one with blanks before another row.

    Nothing but a title may stand left of it, unless rows begin in the first line, as scopes write
    settings.
    """
    blank = len(head)
    for number, line in enumerate(head):
        cells = dialect.cells(line)
        left = any(cell and not VALUES.fullmatch(cell) for cell in cells[: columns.empty])
        if columns.fit(cells) and (number == 0 or not left):
            pairs = zip(cells, columns.kinds, strict=False)
            if all(cell for cell, each in pairs if each in ("number", "stamp")):
                return min(blank, number)
            blank = min(blank, number)
        elif cells:
            blank = len(head)
    return blank


def _below_titles(columns: Kinds, dialect: Dialect, head: list[str], first: int) -> int:
    """Return the place of the first row below names or a title that few rows stand above.

    Those are results, or settings.
    """
    for number in range(min(first + FOOTER, len(head) - 1), first, -1):
        cells = [cell for cell in dialect.cells(head[number]) if cell]
        titles = len(cells) == columns.count > 1 or (len(cells) == 1 and cells[0].endswith(":"))
        if titles and {*map(kind, cells)} == {"text"} and not COMMENT.match(head[number]):
            start = number + 1 + _first_row(columns, dialect, head[number + 1 :])
            return start if start < len(head) else first
    return first


def _undecorated(content: bytes, given: str | None) -> tuple[bytes, list[str], Dialect]:
    """Take arrows, brackets and names before numbers away, and find separator and quotes."""
    if most(_sample(content), UPTIME.match):
        content = UPTIME.sub(_clock, content)
    sample = _sample(content)
    arrows = most(sample, ARROW.match)
    if arrows:
        content = re.sub(rb"(?m)^[ \t]*([\[\d].*[\d\"'])[\])}]+[ \t]*$", rb"\1", content)
        sample = [ARROW.sub(b"", line) for line in _sample(content)]
    elif word := word_before(sample):
        content = re.sub(rb"(?m)^" + re.escape(word), b"", content)
        sample = _sample(content)
    elif most(sample, STAMPED.match):
        content, *sample = (STAMPED.sub(rb"\1,\2", text) for text in (content, *sample))
    for around in WRAPPED:
        if most(sample, around.match):
            content, *sample = (around.sub(rb"\1", text) for text in (content, *sample))
    if names := pair_names(sample):
        separator, quote = "\t", '"'
    else:
        separator, quote = _dialect([line.decode(errors="replace") for line in sample], given)
    if separator == ",":  # 0.01, (0.1, 0.2)
        content = VECTORS.sub(rb'\1"\2"', content)
    if separator == " ":  # INFO: 0.1, 0.2
        content = re.sub(rb"(?<=\d)[,;](?=[ \t])", b"", content)
    if arrows:
        separator = ";" if separator == NO_SEPARATOR else separator
        content = ARROW.sub(
            lambda f: f[1].replace(b",", b".") + (f[2] or b"") + separator.encode(), content
        )
    if names:
        lines = content[:HEAD].split(b"\n")
        first = [n.encode() for n in names]
        begin = next((n for n, line in enumerate(lines) if PAIR.findall(line) == first), 0)
        place = sum(len(line) + 1 for line in lines[:begin])
        content = content[:place] + without_names(content[place:], names)
        names = ["time", *names] if arrows else names
    return content, names, Dialect(separator, quote)


def _clock(found: re.Match[bytes]) -> bytes:
    if found[2]:
        return found[2]
    seconds = int(found[1]) / 1000 if found[1] else float(found[3])
    return b"[%d:%02d:%09.6f]" % (seconds // 3600, seconds // 60 % 60, seconds % 60)


def _sample(content: bytes) -> list[bytes]:
    """Return whole lines from the second half, where numbers stand; comments are none."""
    half = len(content) // 2
    middle = content[half : half + HEAD // 8] if half > HEAD else content
    lines = without_comments(middle).split(b"\n")
    if half > HEAD:  # it may begin and end within a line
        lines = lines[1:-1] or [middle]
    plain = [line for line in lines if line.strip(b" \t,;")]
    if not plain:
        raise TableError("holds no numbers; give one sample a line")
    kept = plain[:-1] if len(plain) > 2 else plain  # the last may be cut
    return kept[(len(kept) - 1) // 2 :][:SAMPLE]


def _dialect(lines: list[str], given: str | None) -> tuple[str, str]:
    """Find separator and quotes in lines of numbers."""
    import clevercsv

    plain = (VECTOR.sub("0", line.strip(" ")[:SHOWN]) for line in lines)
    text = "\n".join(UNIT_BEHIND.sub("", line) for line in plain)
    found = clevercsv.Detector().detect(text, delimiters=SEPARATORS)
    separator, quote = (found.delimiter, found.quotechar) if found else ("", "")
    if given:
        separator = given
    elif all(map(COMMAS.fullmatch if separator == "," else MIXED.match, lines)):
        separator = " "
    elif separator == "," and min(semicolons := {line.count(";") for line in lines}) > 0:
        separator = ";" if len(semicolons) == 1 else separator  # of 1 234,5
    return separator or NO_SEPARATOR, quote or '"'


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
        return stated_rate(above[-1:]) is None and kind(above[-1].strip()) == "text"
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


def _with_heading(
    content: bytes, dialect: Dialect, columns: Kinds, head: list[str], start: int, names: list[str]
) -> tuple[bytes, Layout]:
    """Read what stands above and below the numbers, and how these are written."""
    above = [line for line in head[:start] if line.strip(RULE)]  # and no line between
    notes: list[str] = []
    above = with_statements(above, dialect, columns.count)
    decimal, thousands = decimal_mark(
        [cell for cell in column if kind(cell) == "number" and not VECTOR.fullmatch(cell)]
        for column in zip(*columns.rows, strict=True)
    )
    heading, rate = [names], None
    if not names:
        listed = _lists_settings(above, dialect, columns, apart=not head[start - 1].strip(RULE))
        heading, rate = read_heading(above, dialect, columns, notes, listed=listed)
    left = head[start : start + SAMPLE] if columns.empty else []  # of the numbers
    below_titles = (f"{a} {b}" for a, b in pairwise(above) if a.rstrip().endswith(":"))
    rate = rate or stated_rate([*above, *left, *below_titles], decimal)
    if factor := next((line.strip() for line in above if FACTOR.fullmatch(line.strip())), ""):
        raise TableError(f"has numbers that {factor!r} is to multiply; write them in full")
    count = SAMPLES.search("\n".join(above))
    if names and above and re.search(r"[:=]\s*[-+.\d]", above[-1]) and not rate:
        notes.append(f"an incomplete line of numbers is left out: {above[-1].strip()[:40]!r}")
    notes += rate_doubts(above, columns.rows, rate, decimal)
    first = dialect.cells(head[start])
    titled = heading and (names or len(dialect.cells(above[-1])) == columns.count)  # or prose is
    if not titled and is_numbering(first, columns.rows):
        heading, start = [first], start + 1
    elif not titled and is_beginning(first, columns.rows):  # and a rate below, as Empatica has
        second = stated_rate(["fs=" + dialect.cells(head[start + 1])[0]])
        heading, rate, start = [], second, start + 2
    elif not heading and is_beyond(first, columns.rows):
        rate, start = lone_rate(first[0], columns.rows, notes), start + 1
    _check_decimal(columns)
    place = len("\n".join(head[:start]).encode()) + (start > 0)
    data, below = without_footer(content[place:], dialect, columns)
    plain = without_comments(data)
    told, again = _between(data, plain, above)
    named, units = names_and_units(heading)
    return plain, Layout(
        dialect, decimal=decimal, thousands=thousands, names=named, units=units, rate=rate,
        words={n: WORDS[each] for n, each in enumerate(columns.kinds) if each in WORDS},
        count=int("".join(count.groups(""))) if count else None,
        first_line=start + 1, again=again, notes=(*notes, *below, *told),
    )  # fmt: skip


def _lists_settings(above: list[str], dialect: Dialect, columns: Kinds, *, apart: bool) -> bool:
    """Return whether the last lines above are titles with one value each, which are no names.

    They are ``apart`` if an empty line follows them.
    """
    last = [dialect.cells(line) for line in above[-3:]]
    pairs = apart and columns.count > 1 and [*map(len, last)] == [2, 2, 2]
    if pairs and columns.count == 2:
        title, value = last[-1]
        pairs = kind(value) == "number" and not TIMES & {*split_words(title)}
    return pairs or bool(KEYS.search("\n".join(above)))


def _check_decimal(columns: Kinds) -> None:
    """Reject binary numbers, which would be read as decimal ones."""
    for column in zip(*columns.rows, strict=True):
        if len({*column}) > 2 and all(map(BITS.fullmatch, column)) and min(column)[0] == "0":
            raise TableError(f"has binary numbers such as {column[0]!r}; write decimal ones")


def _between(data: bytes, plain: bytes, above: list[str]) -> tuple[list[str], str]:
    """Return what to say of empty lines and remarks between numbers, and one that is above, too."""
    remarks, empty = data.count(b"\n") - plain.count(b"\n"), len(EMPTY.findall(data))
    found = {"empty": empty if empty < FOOTER else 0, "commented": remarks}
    again = (x for x in above if remarks and COMMENT.match(x) and re.search(r"\w\w", x))
    again = (x for x in again if f"\n{x}\n".encode() in data)
    told = (
        inflected(count, f"{what} line stands", f"{what} lines stand")
        for what, count in found.items()
        if count
    )
    said = "between the numbers, which are read as one recording"
    return [f"{lines} {said}" for lines in told], next(again, "")
