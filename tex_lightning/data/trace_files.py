"""Samples of a trace as they stand in its file, or in three with an axis each.

Sounds and NumPy arrays are read by their libraries. Text has one sample a line, in columns that
stand apart by comma, semicolon, tab or space; understood are decimal commas, comment lines that
begin with ``#`` or ``%``, up to two lines of names and units, byte order marks, UTF-16, trailing
delimiters and a column of time (:mod:`.time_column`).

XML is that of the Penn Haptic Texture Toolkit (HaTT): ``SampleRate`` holds the rate in Hz,
``AccelX``, ``AccelY`` and ``AccelZ`` the samples, as do ``x``, ``y`` and ``z`` inside ``Accel`` or,
for one axis, ``Accel``. White space, commas, semicolons or elements divide the numbers. Other
elements are passed over. A document type is refused, so that no entity can expand.
"""

import codecs
import math
import re
from collections import defaultdict
from contextlib import suppress
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

import numpy as np
import numpy.typing as npt
import soundfile

from tex_lightning.core.console import quietly
from tex_lightning.core.files import check_lines, is_file, require_file
from tex_lightning.data.time_column import RawTrace, choose_channel, separate_time
from tex_lightning.errors import UserError, reason

MARKS = ("#", "%")
PLAIN = b"0123456789+-.eE\r\n"  # of a file of one number a line
MAX_HEADER = 2  # names and units


def read_text_trace(path: Path, channel: int | None = None) -> RawTrace:
    """Read the columns of a text file and take its column of time out of them.

    Of the others one is kept if ``channel``, counted from 0, says which.

    Raises:
        ValueError: If it holds no numbers, or they cannot be told apart.
        UserError: If its column of time cannot be used.
    """
    content = path.read_bytes()
    if content.strip() and not content.translate(None, PLAIN):  # no dialect to find out
        with suppress(ValueError):
            return separate_time(path, np.loadtxt(path, ndmin=2), None, None, channel)
    comments, header, data = _divide(_decode(content))
    if not data:
        raise ValueError("no numbers")
    if len(header) > MAX_HEADER:
        raise ValueError(f"{len(header)} lines of words before the numbers: begin them with #")
    delimiter, decimal_comma = _dialect(data)
    lines = [line.replace(",", ".") for line in data] if decimal_comma else data
    columns = np.loadtxt(lines, delimiter=delimiter, ndmin=2)
    names, units = _names(header or comments[-MAX_HEADER:], delimiter, columns.shape[1])
    return separate_time(path, columns, names, units, channel)


def _decode(content: bytes) -> str:
    """Text of UTF-16 (Excel's "Unicode text"), UTF-8 or, for names alone, Latin-1."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _divide(text: str) -> tuple[list[str], list[str], list[str]]:
    """Comments before the numbers, header, and lines of numbers; no quotes, no trailing marks."""
    comments: list[str] = []
    header: list[str] = []
    data: list[str] = []
    for raw in text.replace('"', "").splitlines():
        line = raw.strip().rstrip(";,\t ")
        if line.startswith(MARKS):
            if not data:
                comments.append(line.lstrip("#% \t"))
        elif line and (data or _is_numbers(line)):
            data.append(line)
        elif line:
            header.append(line)
    return comments, header, data


def _is_numbers(line: str) -> bool:
    try:
        [float(field) for field in re.split(r"[;,\s]+", line) if field]
    except ValueError:
        return False
    return True


def _dialect(data: list[str]) -> tuple[str | None, bool]:
    """Delimiter (None is white space) and whether commas are decimal commas."""
    first = data[0]
    if ";" in first:
        delimiter = ";"
    elif "," in first and not re.search(r"\d[ \t]+[-+.\d]", first):
        return ",", False
    else:
        delimiter = None
    if not any("," in line for line in data):
        return delimiter, False
    if any("." in line for line in data):
        raise ValueError("it has both decimal points and commas inside its columns")
    return delimiter, True


def _names(
    lines: list[str], delimiter: str | None, count: int
) -> tuple[list[str] | None, list[str] | None]:
    """Names and units of ``count`` columns, as far as header or comments have that many."""
    rows = [cells for line in lines if (cells := _cells(line, delimiter, count)) is not None]
    if not rows:
        return None, None
    return rows[0], rows[1] if len(rows) > 1 else None


def _cells(line: str, delimiter: str | None, count: int) -> list[str] | None:
    """The cells of a line if there are ``count``; names may be divided otherwise than numbers."""
    marks: list[str | None] = [
        mark for mark in (delimiter, "\t", ";", ",") if mark and mark in line
    ]
    for mark in marks or [None]:
        cells = [cell.strip() for cell in line.split(mark)]
        if len(cells) == count:
            return cells
    return None


RATE = "samplerate"
ACCELERATION = "accel"
AXES = ("accelx", "accely", "accelz")
SHOWN = {RATE: "SampleRate", "accelx": "AccelX", "accely": "AccelY", "accelz": "AccelZ"}


def read_xml_trace(path: Path) -> RawTrace:
    """Read acceleration and rate.

    Raises:
        ValueError: If it is no whole XML file, has a document type, or rate or samples are missing
            or no numbers.
    """
    collected = _Collector()
    parser = expat.ParserCreate()
    parser.StartElementHandler = collected.start
    parser.EndElementHandler = collected.end
    parser.CharacterDataHandler = collected.characters
    parser.StartDoctypeDeclHandler = _refuse
    try:
        with path.open("rb") as stream:
            parser.ParseFile(stream)
    except expat.ExpatError as error:
        raise ValueError(f"it is no whole XML file: {error}") from error
    numbers = {name: _numbers(name, text) for name, text in collected.text.items()}
    return RawTrace(_axes(numbers), _rate(numbers.get(RATE, np.empty(0))))


class _Collector:
    """Text of the elements that are read, by name, without their children's names."""

    def __init__(self) -> None:
        self.text: dict[str, list[str]] = defaultdict(list)
        self.names = [""]  # what the text of the open elements belongs to

    def start(self, tag: str, _: dict[str, str]) -> None:
        name = tag.rpartition(":")[2].lower()
        inside = self.names[-1]
        if inside == ACCELERATION and name in ("x", "y", "z"):
            name = f"{inside}{name}"
        known = name in (RATE, ACCELERATION, *AXES)
        self.names.append(name if known else inside)
        self.characters(" ")

    def end(self, _: str) -> None:
        self.characters(" ")
        self.names.pop()

    def characters(self, text: str) -> None:
        if self.names[-1]:
            self.text[self.names[-1]].append(text)


def _refuse(*_: object) -> NoReturn:
    raise ValueError("it has a document type (DOCTYPE), which is not read; take that line out")


def _numbers(name: str, pieces: list[str]) -> npt.NDArray[np.float64]:
    words = re.split(r"[\s,;]+", "".join(pieces).strip())
    try:
        return np.array([word for word in words if word], np.float64)
    except ValueError as error:
        raise ValueError(f"{SHOWN.get(name, name)} holds what is no number: {error}") from error


def _rate(found: npt.NDArray[np.float64]) -> float:
    if len(found) != 1:
        raise ValueError(f"it has {len(found) or 'no'} SampleRate where one number of Hz is needed")
    if not 0 < found[0] < inf:
        raise ValueError(f"its SampleRate is {found[0]:g}, which is no positive number of Hz")
    return float(found[0])


def _axes(numbers: dict[str, npt.NDArray[np.float64]]) -> npt.NDArray[np.float64]:
    """Samples (axes, samples), three axes or one."""
    axes = [numbers.get(name, np.empty(0)) for name in AXES]
    single = numbers.get(ACCELERATION, np.empty(0))
    if not any(len(axis) for axis in axes) and len(single):
        return single[None]
    missing = [SHOWN[name] for name, axis in zip(AXES, axes, strict=True) if not len(axis)]
    if missing:
        raise ValueError(f"it has no samples of {', '.join(missing)}")
    if len({len(axis) for axis in axes}) > 1:
        counts = ", ".join(str(len(axis)) for axis in axes)
        raise ValueError(f"AccelX, AccelY and AccelZ have {counts} samples, which differ")
    return np.stack(axes)


SOUND_SUFFIXES = (".wav", ".flac")  # what libsndfile decodes
TRACE_SUFFIXES = (*SOUND_SUFFIXES, ".npy", ".txt", ".csv", ".xml")
RATE_TOLERANCE = 0.01
MOST_SAMPLES = 1 << 29  # of a file, 2 GiB of float32: 14 h of one axis at 10 kHz
LARGEST_TEXT = 1 << 29  # bytes
DAMAGE = (soundfile.SoundFileError, ValueError, EOFError, OSError, LookupError, MemoryError)
UNKNOWN_LENGTH = 0x7FFF0000  # programs that stream write such a length for want of a better one


def axis_paths(path: Path) -> tuple[Path, ...]:
    """The files of one recording that are there, in the order of their axes.

    Files are axes of one recording if their names differ in ``_X_``, ``_Y_``, ``_Z_`` before the
    last part of the name (``G1Mesh_Movement_X_train1.txt``). Any of the three stands for all.
    """
    found = tuple(file for file in _axis_names(path) if is_file(file))
    return found if len(found) > 1 else (path,)


def axis_files(path: Path) -> tuple[Path, ...]:
    """The files of one recording: three if its axes lie apart, as in LMT-108, else the file alone.

    Raises:
        UserError: If two of the three are there.
    """
    files = axis_paths(path)
    if len(files) == 2:
        (missing,) = set(_axis_names(path)) - set(files)
        raise UserError(
            f"Trace {path} is one axis of three, but {missing} does not exist; add it "
            "or, if it is no axis, rename the file."
        )
    return files


def _axis_names(path: Path) -> tuple[Path, ...]:
    match = re.fullmatch(r"(.+_)[XYZ](_[^_]+)", path.name)
    if match is None or path.suffix.lower() not in TRACE_SUFFIXES:
        return (path,)
    return tuple(path.with_name(f"{match[1]}{axis}{match[2]}") for axis in "XYZ")


def read_axes(path: Path, channel: int | None = None) -> RawTrace:
    """Read the samples out of one file or three; of a file only one channel if that is given.

    Raises:
        UserError: If a file is missing, empty, damaged or of another shape, or its column of time
            cannot be used.
    """
    axes = []
    for file in axis_files(path):
        require_file(file)
        axes.append(_read_file(file, channel))
    if len(axes) == 1:
        return axes[0]
    if {axis.samples.shape for axis in axes} != {(1, axes[0].samples.shape[1])}:
        shapes = ", ".join(" x ".join(map(str, axis.samples.shape)) for axis in axes)
        raise UserError(
            f"The axes X, Y, Z of trace {path} have {shapes} samples; they must be single and of "
            "one length."
        )
    rates = [axis.rate or 0.0 for axis in axes]
    if not all(same_rate(rate, rates[0]) for rate in rates):
        told = ", ".join(f"{rate:,.6g} Hz" if rate else "none" for rate in rates)
        raise UserError(f"The axes X, Y, Z of trace {path} have the rates {told}; make them equal.")
    samples = np.concatenate([axis.samples for axis in axes])
    return replace(axes[0], samples=samples, interpolated=any(axis.interpolated for axis in axes))


def same_rate(one: float, other: float) -> bool:
    """Whether two rates in Hz may be told of one file; a column of time is never exact."""
    return math.isclose(one, other, rel_tol=RATE_TOLERANCE)


def _read_file(path: Path, channel: int | None) -> RawTrace:
    suffix = path.suffix.lower()
    try:
        if suffix in SOUND_SUFFIXES:
            _check_wav_length(path)
            _check_samples(path)
            samples, rate = soundfile.read(path, dtype="float32", always_2d=True)
            samples = choose_channel(path, samples, channel)
            if samples.shape[1] == 2:
                raise UserError(
                    f"Trace {path} has two channels, but a trace has one or three axes; choose one "
                    "by +model.SENSE.decode.channel=0, or save it with one."
                )
            return RawTrace(_as_axes(path, samples), float(rate))
        if suffix == ".npy":
            array = _read_array(path)
            return RawTrace(_as_axes(path, _chosen(path, array, channel)))
        if suffix in (".txt", ".csv"):
            _check_text(path)
            text = read_text_trace(path, channel)
            return replace(text, samples=_as_axes(path, text.samples))
        if suffix == ".xml":
            _check_text(path)
            trace = read_xml_trace(path)
            return replace(trace, samples=_chosen(path, trace.samples, channel))
    except DAMAGE as error:
        raise UserError(
            f"Trace {path} cannot be read ({reason(error)}); replace the file."
        ) from error
    raise UserError(f"Trace {path} has an unknown type; use {', '.join(TRACE_SUFFIXES)}.")


def _chosen(
    path: Path, array: npt.NDArray[np.floating], channel: int | None
) -> npt.NDArray[np.floating]:
    """The channel of an array in either order, which has more samples than channels."""
    if channel is None or array.ndim != 2:
        return array
    return choose_channel(path, array.T if array.shape[0] < array.shape[1] else array, channel).T


def _read_array(path: Path) -> npt.NDArray[np.float64]:
    try:
        with quietly():
            # a map takes no memory for what a header claims
            array = np.load(path, mmap_mode="r", allow_pickle=False)
    except OSError:
        raise
    except Exception as error:  # of any kind; the words of some propose to load it unsafely
        raise ValueError("it is no whole array of numbers as np.save writes it") from error
    if not isinstance(array, np.ndarray):
        raise ValueError("it is an .npz archive; save one array with np.save")
    if array.dtype.kind not in "fiu":
        raise ValueError(f"it holds {array.dtype} instead of numbers")
    if array.size > MOST_SAMPLES:
        raise ValueError(f"it has {array.size:,} samples, and {MOST_SAMPLES:,} are the most")
    return np.array(array, np.float64)


def _check_wav_length(path: Path) -> None:
    """Compare sizes with the header: libsndfile reads a truncated file without a word."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        if stream.read(4) != b"RIFF":
            return
        stream.seek(12)
        while len(header := stream.read(8)) == 8:
            length = int.from_bytes(header[4:], "little")
            if header[:4] == b"data":
                missing = stream.tell() + length - size
                if missing > 0 and length < UNKNOWN_LENGTH:
                    raise ValueError(f"truncated: {missing} of {length} bytes are missing")
                return
            stream.seek(length + length % 2, 1)


def _check_samples(path: Path) -> None:
    """Refuse more samples than anyone records: a small FLAC file may hold hours of silence."""
    with soundfile.SoundFile(path) as sound:
        count = sound.frames * sound.channels
    if count > MOST_SAMPLES:
        raise ValueError(f"its header claims {count:,} samples, and {MOST_SAMPLES:,} are the most")


def _check_text(path: Path) -> None:
    """Refuse text that would not fit into memory as numbers."""
    if (size := path.stat().st_size) > LARGEST_TEXT:
        raise ValueError(
            f"it is {size / 2**20:,.0f} MiB of text, and {LARGEST_TEXT >> 20} are the most: save "
            "it as WAV or .npy, or in parts"
        )
    if path.suffix.lower() != ".xml":  # which may be a single line
        check_lines(path)


def _as_axes(path: Path, samples: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Bring samples of a file to (axes, samples)."""
    trace = axes_first(samples)
    if trace is None:
        raise UserError(
            f"Trace {path} has shape {samples.shape}; a trace has one or three axes (columns), "
            "and a column of time beside them must be called time."
        )
    if trace.shape[1] == 0:
        raise UserError(f"Trace {path} holds no samples; record or copy it again.")
    return trace


def axes_first(samples: npt.NDArray[np.floating]) -> npt.NDArray[np.floating] | None:
    """Bring (samples,), (axes, samples) or (samples, axes) to (axes, samples), one or three axes.

    Returns:
        None if the samples have another shape.
    """
    trace = samples[None] if samples.ndim == 1 else samples
    if trace.ndim == 2 and trace.shape[0] not in (1, 3):
        trace = trace.T
    return trace if trace.ndim == 2 and trace.shape[0] in (1, 3) else None
