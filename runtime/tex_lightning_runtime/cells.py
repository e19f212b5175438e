"""The cells of a table: how lines are divided, and what stands in a cell or column.

That is nothing, a number, a date or clock time, or text.
"""

import csv
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from tex_lightning_runtime.times import STAMP, TableError

USUAL = 0.8  # of the cells of a column, which are of its kind, or all but one
NO_SEPARATOR = "\x1f"  # where there is one column
MISSING = {
    "", "nan", "NaN", "null", "NULL", "none", "None", "na", "NA", "n/a", "N/A", "#N/A", "<NA>", "-",
    "--", "---", "-nan", "nan(ind)", "-nan(ind)", "-1.#IND", "-1.#IND00", "1.#QNAN", "1.#QNAN0",
}  # fmt: skip
NUMBER = re.compile(  # blanks divide no more than thousands
    r"[-+]?([1-9]\d{0,2}([ '’\u00a0\u2009\u202f]\d{3})+([.,]\d*)?|\d([\d.,]*[\d.])?|[.,]\d+)"
    r"(e[-+]?\d+|d[-+]\d+)?|[-+]?inf(inity)?",
    re.I,
)
QUANTITY = re.compile(  # with a unit, which is no exponent: 5E-4
    rf"({NUMBER.pattern})\s*(?P<unit>(?!e[-+]?\d)[^\W\d_][^\d\s,;]{{0,5}}\d?|%|°\w?)", re.I
)
VECTOR = re.compile(  # several numbers in a cell: (0.1, 0.2, 9.8)
    r"[(\[]\s*{0}(?:[,;\s]+{0})+\s*[)\]]".format(r"[-+]?[\d.]+(?:[eE][-+]?\d+)?")
)
THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+")
POINTS = re.compile(r"[-+]?[1-9]\d{0,2}(\.\d{3})+")
WHOLE = re.compile(r"[-+]?\d+")
# Decimal mark and mark of thousands by how numbers are written, the surest form first.
MARKS: dict[str, tuple[str, str | None]] = {
    "1.234,5": (",", "."), "1,234.5": (".", ","), "1,5": (",", None), "1.5": (".", None),
    "1,234,567": (".", ","), "1.234.567": (",", "."), "1,234": (",", None),
}  # fmt: skip


@dataclass(frozen=True)
class Dialect:
    """How the lines of a table are divided."""

    separator: str  # of columns; a blank stands for any white space, two for two or more
    quote: str = '"'  # around cells

    def cells(self, line: str) -> list[str]:
        """Divide a line."""
        if self.separator == " ":
            return line.replace(self.quote, "").split()
        if self.separator == "  ":  # or more
            return re.split(r" {2,}|\t+", line.strip())
        if self.separator == NO_SEPARATOR:
            return [line.strip().strip(self.quote)]
        reader = csv.reader(
            [line], delimiter=self.separator, quotechar=self.quote, skipinitialspace=True
        )
        try:
            return [cell.strip() for cell in next(reader, [])]
        except csv.Error:  # of a cell of more than 131,072 letters, which is no number
            return [line]


def kind(cell: str) -> str:
    """Return what a cell holds: nothing, a number or several, a date or clock time, or text."""
    if cell in MISSING:
        return ""
    if STAMP.fullmatch(cell):
        return "stamp"
    return "number" if any(n.fullmatch(cell) for n in (NUMBER, QUANTITY, VECTOR)) else "text"


class Kinds:
    """What the columns of a table hold, by some of its rows."""

    def __init__(self, rows: Sequence[Sequence[str]]) -> None:
        self.rows = rows
        columns = [*zip(*rows, strict=True)]
        counts = [Counter(map(kind, column)) for column in columns]
        self.kinds = [self._usual(count) for count in counts]
        self.plain = [
            all(NUMBER.fullmatch(c) or c in MISSING for c in column) for column in columns
        ]
        self.count = next((n for n in range(len(counts), 0, -1) if self.kinds[n - 1]), 0)

    @staticmethod
    def _usual(count: Counter[str]) -> str:
        for name in ("number", "stamp", "text"):
            if count[name] and count[name] + 1 >= USUAL * (count.total() - count[""]):
                return name
        return "text" if count.total() > count[""] else ""

    @property
    def numbered(self) -> bool:
        """Whether the first column counts the rows one by one."""
        first = [int(row[0]) if WHOLE.fullmatch(row[0]) else 0 for row in self.rows]
        return len(first) > 2 and all(b - a == 1 for a, b in pairwise(first))

    @property
    def empty(self) -> int:
        """Number of columns without content before the first with any."""
        return next((n for n, kind in enumerate(self.kinds) if kind), 0)

    def fit(self, cells: Sequence[str]) -> bool:
        """Return whether cells are a whole row of the table, with units where it has them."""
        if not self.count <= len(cells) <= len(self.kinds):
            return False
        if any(p and QUANTITY.fullmatch(c) for p, c in zip(self.plain, cells, strict=False)):
            return False
        found = [kind(cell) for cell in cells]
        pairs = [*zip(found, self.kinds, strict=False)]
        whole = all(one in ("", other) for one, other in pairs if other in ("number", "stamp"))
        return whole and any(one == other == "number" for one, other in pairs)


def decimal_mark(columns: Iterable[Sequence[str]]) -> tuple[str, str | None]:
    """Return the decimal mark and that of thousands, if there is one.

    Marks count by column: the whole numbers of a counter say nothing of the fractions beside them,
    but numbers with the other mark than these, of which all may be thousands, are such.

    Args:
        columns: The cells of each column that are numbers.

    Raises:
        TableError: If a column may be of thousands or of fractions.
    """
    forms = {*map(_form, columns)}
    decimal, thousands = next((m for form, m in MARKS.items() if form in forms), (".", None))
    other = "." if decimal == "," else ","
    return decimal, other if f"1{other}234" in forms else thousands


def _form(cells: Sequence[str]) -> str:
    """Return how the numbers of one column are written, a key of :data:`MARKS`, or ""."""
    both = next((cell for cell in cells if "," in cell and "." in cell), None)
    if both:
        return "1,234.5" if both.rindex(",") < both.rindex(".") else "1.234,5"
    for mark, grouped in ((",", THOUSANDS), (".", POINTS)):
        marked = [cell for cell in cells if mark in cell]
        if not marked:
            continue
        if not all(map(grouped.fullmatch, marked)):
            return f"1{mark}5"
        whole = [cell for cell in cells if WHOLE.fullmatch(cell)]
        largest = max((abs(int(cell)) for cell in whole), default=0)
        if any(cell.count(mark) > 1 for cell in marked):
            return f"1{mark}234{mark}567"
        least = min(abs(int(cell.replace(mark, ""))) for cell in marked)
        if 0 < 100 * largest <= least:  # 9,812 and 10
            if mark == ",":
                raise TableError(
                    f"has {marked[0]!r} beside {largest}, whose comma may mark thousands or a "
                    "fraction; write decimal points"
                )
        elif whole and largest < 1000:
            return f"1{mark}234{mark}567"
        return f"1{mark}234"  # of points alone they are decimal
    return ""
