"""Files of text to plain UTF-8: one encoding, one kind of line end, no comments, no decoration."""

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from tex_lightning_runtime.cells import NUMBER, WHOLE
from tex_lightning_runtime.files import MAX_LINE, has_long_line
from tex_lightning_runtime.times import TableError

MAX_TEXT = 1 << 29  # bytes of a file
HEAD = 1 << 18  # bytes in which the numbers begin
LONG_LINE = 1 << 14  # bytes, of more numbers than a sample has
OF_AXES = ("\t", ";", None, ",")  # between the numbers of such a line
MAX_AXES = 1 << 25  # bytes of such lines, which take up to twenty times as much memory
TOO_LONG = "has a line of more than 1 MiB; give one sample a line"
FIRST = 64  # of a file, in which NULs are none of a power failure
BRACKETS = 3  # lines with nothing else, of an array of JSON with an element a line
BINARY = {
    b"PK\x03\x04": "an Excel workbook or another archive",
    b"\xd0\xcf\x11\xe0": "an Excel workbook",
    b"RIFF": "a sound",
    b"fLaC": "a sound",
    b"\x93NUMPY": "an array of NumPy",
    b"%PDF": "a PDF",
    b"MATLAB 5": "a file of MATLAB",
    b"\x89HDF": "an HDF5 file",
    b"PAR1": "a Parquet file",
    b"ARROW1": "a Feather file",
    b"TDSm": "a TDMS file",
    b"#ROSBAG": "a bag of ROS",
    **dict.fromkeys((b"\x1f\x8b", b"BZh", b"\xfd7zXZ", b"7z\xbc\xaf"), "compressed"),
    **dict.fromkeys((b"\x89PNG", b"\xff\xd8\xff"), "a photo"),
}
UTF = {  # by the mark at the beginning
    b"\xef\xbb\xbf": "utf-8-sig",
    b"\xff\xfe\x00\x00": "utf-32",
    b"\x00\x00\xfe\xff": "utf-32",
    b"\xff\xfe": "utf-16",
    b"\xfe\xff": "utf-16",
}
WESTERN = {*"°µ²³·äöüÄÖÜßéèêàçñóúíáã±´’–×§\u00a0"}  # letters of units and names, read as cp1252
COMMENT = re.compile(  # and none of #N/A, #DIV/0!, #VALUE!, which a sheet has in place of numbers
    rb"(?m)^[ \t]*(?:#(?!N/A|NV\b|[A-Z\x80-\xff/0]+[!?])|%|//).*(?:\n|\Z)"
)
REMARK = re.compile(rb"(?m)^[ \t]*;")  # as loggers of Gulf Coast Data Concepts begin it
DIVIDED = re.compile(rb"(?m)^[ \t]*[^;\s][^;\n]*;")  # by semicolons, which begin no remarks
NUMBER_FIRST = re.compile(rb"(?m)^[ \t]*[-+.\d]")
BROKEN = re.compile(rb'(?<![^\n,;\t])"([^"\n]{0,80}(?:\n[^"\n]{0,80}){1,3})"(?=[,;\t\n])')  # names
# Signs of typography for minus, and letters without width.
PLAIN = {**dict.fromkeys("\u2212\u2013", b"-"), **dict.fromkeys("\u200b\u200e\ufeff", b"")}
FRACTION = r"[-+]?\d*\.\d+"
TAG = (  # level, module and mark of a logger; a name before the only number is none
    r"(?: \| [A-Z]+ *\| )?"
    r"(?:[^\d\n\t,;|=]|(?<=[a-z_:])\d+)*(?:[]>]|<-|◆|(?:INFO|DEBUG)(?=.*,)|(?<= )-(?= )"
    r"|:(?= +(?:[^\W\d]|[\[({]|[-+.\d]+[,; \t]+[-+.\d][^:=\n]*$)))"
)
ARROW = re.compile(  # of monitors of serial ports, and of loggers: 10:00:00.001 -> 0.1
    r"(?m)^[ \t]*(?:\[ *[A-Z]+\] )?\[?(?:\d\d-\d\d (?=\d))?"
    r"((?:[\d./-]+[ T])?\d{1,2}:\d\d:\d\d(?:[.,:]\d+)?"
    r"(?:Z|[-+]\d\d:?\d\d| ?[AP]M)?|(?<=\[)\d{10}\.\d+)(?:,(\d{3})(?=\]))?"
    r"(?: +\d+ +\d+(?= [A-Z] ))?"  # of processes and threads
    rf"(?: (?={FRACTION} ?[,;\t] ?{FRACTION}|-?\d+(?:, ?-?\d+){{2}}|\w+=|[\[({{] ?[-+.\d\"'])"
    rf"|\t(?={FRACTION}, ?{FRACTION})|{TAG})[ \t\[({{]*+(?![,;\t|])".encode()
)
UPTIME = re.compile(  # in ms or s, or of the day
    rb"(?m)^(?:[A-Z] \((?:(\d+)|([\d:.]+))\) (?=\S+: )|\[ *(\d{1,6}\.\d{3,})\](?=.*\d))"
)
STAMPED = re.compile(  # 1000 1,2,3 and 0.01 (1, 2, 3)
    rb"(?m)^[ \t]*(\d{4,}|\d+\.\d+)(?::? ?[(\[]|[: \t] ?(?=[^,\n]+,[^,\n]+,))"
    rb"([-+.\deE]+(?:, ?[-+.\deE]+)+)[\])]?[ \t]*$"
)
WORD = re.compile(  # before all numbers: ACC: 0.1,0.2
    rb"[ \t]{0,40}(?=[^,;|\t]{0,80}[A-Za-z])[^\s\d,;|\t\"'{][^,;|\t]{0,80}?(?:[:>\])=(]|(?<=\w) )"
    rb" {0,40}(?=([\[(<]{0,2}[-+.\d][^\s,;|\t]{0,40}[,;|\t])(?!.*\d +[-+.\d]))"
)
PAIR = re.compile(  # name:number or name=number, as plotters of serial ports read them
    rb"(?m)(?:^|(?<=[\s,;|{(]))[\"']?((?:[A-Za-z]\w* )?[A-Za-z_\x80-\xff]"
    rb"(?:[\w.\x80-\xff/^-]|\([^()\n]*\))*)[\"']?[ \t]*[:=][ \t]*(?=[\"']?[-+]?\.?\d)"
)
NO_THOUSANDS = rb"(?![-+]?[1-9]\d{0,2}(?: \d{3})+(?:[.,]\d*)?[;,][ \t]*$)"  # 1 234,5; of one column
WRAPPED = (  # rows in brackets, or in quotes around several cells, or with a mark at their end
    re.compile(
        rb"(?m)^[ \t]*(?![(\[][^(\[\n]*[)\]] *, *[(\[])(?:[\[({]++|<(?=[-+.\d]))[ \t]*+"
        rb"(.*[^\])}> \t\n])[ \t]*[\])}>]+,?[ \t]*$"
    ),
    re.compile(
        rb'(?m)^"(?=[^"\n;\t]*[;\t]|[^"\n.]*\.[^"\n,]*,[^"\n.]*\.|[^"\n]*[A-Za-z)],)'
        rb'([^"\n]*)"[ \t]*$'
    ),
    re.compile(
        rb"(?m)^%b(?=[^,;\n]*,[^,;\n]*,|[-+]?\d+, ?[-+]?\d+;|[^;\n]*\d[ \t|]+[-+.\d])"
        rb"([^;\n]*+);[ \t]*$" % NO_THOUSANDS
    ),
    re.compile(rb"(?m)^%b(?=[^,\n]*\d[ \t|;]+[-+.\d])([^,\n]*+),[ \t]*$" % NO_THOUSANDS),
)
VALUE = re.compile(  # and its unit, and what else stands before the next that has a name
    rb"\x1f[\"']?([^\s;|\"'}\]\x1f]*[^\s,;|\"'}\])\x1f](?: [A-Za-z%\x80-\xff][^\s,;|\"'}\]:=]*)?)"
    rb"(?:[^\x1f\n:=]|[:=][ \t]*(?=[\x1f\n]|\Z))*"
)
BEGINS = re.compile(rb"(?<![^\s,;|:={\"'])[-+]?\.?\d")  # numbers


def read_utf8(path: Path) -> bytes:
    """Return the content of a file of text in UTF-8.

    Raises:
        TableError: If it is no text, or too much.
    """
    check_size(path)
    content = path.read_bytes()
    for start, kind in BINARY.items():
        if content.startswith(start):
            raise TableError(f"is {kind} by its content and no text; export it as CSV")
    content = _utf8(content).rstrip(b"\0\x1a")
    if b"\0" in content:
        line = content[: content.index(b"\0")].count(b"\n") + 1
        if line == 1 or b"\0" in content[:FIRST]:
            raise TableError("is no text by its content; export it as CSV")
        raise TableError(f"has NUL bytes in line {line}, as power failures leave; cut them out")
    return content


def read_plain(path: Path) -> bytes:
    r"""Return the content as :func:`read_utf8` does, with lines that end in ``\n``."""
    content = read_utf8(path)
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    content = content.replace(b"*^", b"e")  # 1.5*^-3 of Mathematica
    if b'"' in content[:HEAD]:  # lines within a cell
        names = BROKEN.sub(lambda found: found[0].replace(b"\n", b" "), content[:HEAD])
        content = names + content[HEAD:]
    if b";" in content and not DIVIDED.search(content) and NUMBER_FIRST.search(content):
        content = REMARK.sub(b"#", content)
    if b"\x1b" in content:
        content = re.sub(rb"\x1b\[[\d;?]*[A-Za-z]", b"", content)  # colours and places
    for letter, plain in () if content.isascii() else PLAIN.items():
        content = content.replace(letter.encode(), plain)
    if content[:FIRST].lstrip()[:1] in b"[{" and _is_json(content):
        raise TableError(
            "is JSON; write it as CSV, one sample a line below a line of names, in Python"
        )
    return content


def _is_json(content: bytes) -> bool:
    """Return whether it is JSON, and not numbers, or flat objects of them, one a line.

    A first line of settings, with a table below it, is a heading.
    """
    first, _, rest = content.partition(b"\n")
    for text in (content, first) if rest.lstrip()[:1] in b"[{" else (content,):
        try:
            found = json.loads(text)
        except (ValueError, RecursionError):
            continue
        parts = [*found.values()] if isinstance(found, dict) else found
        inside = [part for part in parts if isinstance(part, list | dict)]
        lines = text.count(b"\n") + 1
        if inside and (isinstance(found, dict) or not -1 <= lines - len(found) <= BRACKETS):
            return True
    return False


def check_size(path: Path) -> None:
    """Reject a file that would take all memory, before it is read."""
    if (size := path.stat().st_size) > MAX_TEXT:
        raise TableError(f"is {size:,} bytes of text, more than {MAX_TEXT:,}; save it as WAV")
    with path.open("rb") as stream:
        begin = stream.read(LONG_LINE).decode(errors="replace")
    if (size > MAX_AXES or not _begins_with_an_axis(begin)) and has_long_line(path):
        raise TableError(TOO_LONG)


def _begins_with_an_axis(text: str) -> bool:
    """Return whether a line goes on beyond a text of numbers, before which a name may stand."""
    whole = (text.split(separator)[1:-1] for separator in OF_AXES)
    return "\n" not in text and any(map(_are_numbers, filter(None, whole)))


def _are_numbers(cells: Sequence[str]) -> bool:
    return all(NUMBER.fullmatch(cell.strip()) for cell in cells)


def _utf8(content: bytes) -> bytes:
    """Return the content in UTF-8, without a mark at its beginning."""
    for mark, encoding in UTF.items():
        if content.startswith(mark):
            if encoding == "utf-8-sig":
                return content[len(mark) :]
            return content.decode(encoding, "ignore").encode()  # it may end within a letter
    head = content[:HEAD]
    even, odd = head[::2].count(0), head[1::2].count(0)
    if abs(even - odd) > len(head) / 4:
        return content.decode("utf-16-be" if even > odd else "utf-16-le", "ignore").encode()
    try:
        content.decode()
    except UnicodeDecodeError:
        lines = [line for line in content[:HEAD].splitlines() if not line.isascii()]
        told = b"\n".join(lines)  # numbers would hide what the letters are
        western = {*told.decode("cp1252", "replace")} - WESTERN
        encoding = "cp1252"
        if not all(map(str.isascii, western)):
            from chardet import detect

            encoding = detect(told)["encoding"] or encoding
        return content.decode(encoding, "replace").encode()
    return content


def with_long_lines_as_columns(content: bytes) -> tuple[bytes, int]:
    """Return the content with lines too long for a sample as columns, and their number.

    They are axes, as of an array (axes, samples). The number is 0 where they stay lines: where not
    all are of as many numbers, a name aside, or all begin or end with a whole number beside a
    fraction, which may be a label, and in a column a name.

    Raises:
        TableError: If lines of more than 1 MiB stay lines.
    """
    if len(content) <= LONG_LINE or b"\n" in content[:LONG_LINE]:
        return content, 0
    lines = content.decode(errors="replace").strip().split("\n")
    for separator in OF_AXES:
        rows = [[*map(str.strip, line.strip(separator).split(separator))] for line in lines]
        numbers = all(_are_numbers(row[1:]) for row in rows)
        if len({*map(len, rows)}) == 1 and len(rows[0]) > len(rows) and numbers:
            columns = [*zip(*rows, strict=True)]
            first, second, last = (all(map(WHOLE.fullmatch, columns[n])) for n in (0, 1, -1))
            if second or not (first or last):
                return "\n".join(map("\t".join, columns)).encode(), len(rows)
    if any(len(line) > MAX_LINE for line in lines):
        raise TableError(TOO_LONG)
    return content, 0


def without_comments(content: bytes) -> bytes:
    """Drop the lines that begin as comments do."""
    marked = any(mark in content for mark in (b"#", b"%", b"//"))  # much quicker than to search
    return COMMENT.sub(b"", content) if marked else content


def pair_names(lines: list[bytes]) -> list[str]:
    """Return the names of the numbers, if nearly all lines have one before each; else none."""
    if not most(lines, lambda line: 0 < len(PAIR.findall(line)) == len(BEGINS.findall(line))):
        return []
    return [name.decode() for name in PAIR.findall(lines[len(lines) // 2])]


def word_before(lines: list[bytes]) -> bytes:
    """Return what all lines begin with before numbers that have no names; nothing if they differ.

    Text that a separator follows, or a number that stays the same, is a column.
    """
    found = WORD.match(lines[0])
    if found is None or pair_names(lines):
        return b""
    first = found[0] + found[1]
    alike = most(lines, lambda line: line.startswith(found[0]))
    return found[0] if alike and not all(line.startswith(first) for line in lines) else b""


def without_names(content: bytes, names: list[str]) -> bytes:
    """Drop what is neither a number nor its unit; names have to be the same in all lines."""
    found = PAIR.findall(content)
    for number, name in enumerate(names):
        if {*found[number :: len(names)]} != {name.encode()}:
            raise TableError(
                f"does not have {', '.join(names)} in every line; write the same numbers in each"
            )
    plain = re.sub(rb"(?m)(^|\t)[^\x1f\n\t]+(?=\x1f)", rb"\1", PAIR.sub(b"\x1f", content))
    return re.sub(rb"(?m)^[ \t]+|\t$", b"", VALUE.sub(rb"\1\t", plain))


def most(lines: list[bytes], fits: Callable[[bytes], object]) -> bool:
    """Return whether nearly all lines fit."""
    return bool(lines) and sum(bool(fits(line)) for line in lines) > 0.8 * len(lines)
