"""Sources of recordings: pipes, files, cameras and, with ``live``, serial ports and sound cards.

Bytes of a sensor are parsed strictly: what cannot be meant raises an error that names its place.
"""

import importlib
import math
import re
from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tex_lightning.config.data import SourceConfig
from tex_lightning.core.files import standard_input
from tex_lightning.data.decode import RATE_TOLERANCE, SignalDecoder
from tex_lightning.errors import UserError, reason, shorten
from tex_lightning_runtime.files import expanded
from tex_lightning_runtime.samples import check_samples
from tex_lightning_runtime.traces import TRACE_SUFFIXES

Chunk = npt.NDArray[np.float32]  # (axes, samples)
Pixels = npt.NDArray[np.uint8]  # (height, width, 3), colours as OpenCV has them: BGR
SAMPLE = np.dtype("<f4")
LONGEST_LINE = 1000  # bytes; what goes on without a line's end is no text
NUMBERS = set(b"0123456789+-.,;eE# \t\r\n")


class Parser:
    """Turns pieces of bytes, cut anywhere, into samples.

    Little-endian float32, the axes of a sample one after another, or text: a sample a line, numbers
    apart by comma, semicolon or white space; # begins a remark.

    Args:
        name: The source as it was given, for messages.
        key: Section of its settings, such as ``record.haptic``.
        settings: That section: its format, and numbers of one sample.
        cut: Whether the first line may have begun before we listened, and is passed over.
    """

    def __init__(self, name: str, key: str, settings: SourceConfig, *, cut: bool = False) -> None:
        self.name, self.key, self.axes = name, key, settings.axes
        self.text, self.cut = settings.format == "text", cut
        self.rest = b""  # of a sample that is not whole yet
        self.count = 0  # samples so far
        kind = "a line of text with" if self.text else "little-endian float32,"
        self.expected = f"send {kind} {self.axes} numbers for each ({key}.axes)"

    def feed(self, content: bytes) -> Chunk:
        """Return the samples (axes, samples) that are whole now, perhaps none.

        Raises:
            UserError: If they are not of the format, or hold NaN or infinity.
        """
        take = self._lines if self.text else self._floats
        samples = take(self.rest + content).reshape(-1, self.axes).T
        check_samples(samples, self.name, self.count)
        self.count += samples.shape[1]
        return np.ascontiguousarray(samples, dtype=np.float32)

    def end(self) -> None:
        """Reject an end within a sample; the last line of text may lack its end.

        Raises:
            UserError: If there was one.
        """
        if self.rest and not self.text:
            raise UserError(f"{self.name} ends within a sample; {self.expected}.")

    def _floats(self, content: bytes) -> npt.NDArray[Any]:
        if not self.count and len(content) >= SAMPLE.itemsize and NUMBERS.issuperset(content):
            raise UserError(
                f"{self.name} sends text, {shorten(content[:20])}; set {self.key}.format=text."
            )
        whole = len(content) - len(content) % (self.axes * SAMPLE.itemsize)
        self.rest = content[whole:]
        return np.frombuffer(content[:whole], SAMPLE)

    def _lines(self, content: bytes) -> npt.NDArray[Any]:
        *lines, self.rest = content.split(b"\n")
        if len(self.rest) > LONGEST_LINE:
            raise UserError(f"{self.name} sends no lines of text; set {self.key}.format=float32.")
        if lines and self.cut:
            lines, self.cut = lines[1:], False
        texts = [line.decode("ascii", "replace").strip().rstrip(",;") for line in lines]
        rows = [self._row(text) for text in texts if text and not text.startswith("#")]
        return np.array(rows, np.float64)

    def _row(self, text: str) -> list[float]:
        try:
            row = [float(field) for field in re.split(r"\s*[,;\s]\s*", text)]
        except ValueError:
            row = []
        if len(row) != self.axes:
            raise UserError(
                f"{self.name} sends the line {shorten(repr(text))}; {self.expected}, remarks "
                "behind #."
            )
        return row


PIECE = 65_536  # most bytes read at once
WAIT = 0.2  # seconds after which a reader looks whether it should stop
Pieces = Generator[Chunk | None, None, None]
Read = Callable[[], bytes | None]  # b"" at the end, None where nothing came for a while


@dataclass
class Source:
    """A signal that arrives piece by piece.

    Attributes:
        rate: Rate in Hz.
        chunks: Opens the source and yields samples (axes, samples) as they come, until the end;
            None now and then if none come. It raises a UserError if the source cannot be opened,
            or sends what cannot be used, and closes it at the end.
        timed: Whether samples come when they are taken, so that their rate can be measured.
        lost: Whether samples were lost on the way.
    """

    rate: int
    chunks: Callable[[], Pieces]
    timed: bool = False
    lost: bool = False


def open_source(modality: str, text: str, settings: SourceConfig) -> Source:
    """Open the source that a person names.

    Args:
        modality: Modality of the signal, which is also the key.
        text: ``-``, ``serial:PORT``, ``soundcard``, ``soundcard:NAME``, or a path.
        settings: Section of the source.

    Raises:
        UserError: If the source is not there or cannot be used, or its rate is missing.
    """
    name, key = f"{modality}={text}", f"record.{modality}"
    kind, _, address = text.partition(":")
    if kind == "soundcard":
        return _sound_card(name, address, settings)
    path = expanded(text)
    if path.suffix.lower() in TRACE_SUFFIXES and path.is_file():
        return _recorded_file(path, name, key, settings.rate)
    if settings.rate is None:
        raise _no_rate(name, key)
    parser = Parser(name, key, settings, cut=kind == "serial")
    if kind == "serial":
        opened = partial(_open_serial, _library("serial", name), address, settings.baud)
        remedy = "check the name of the port, and that no other program has it"
    elif text == "-" or path.exists():
        opened, remedy = partial(_open_pipe, path), "check the path, and who writes to it"
    else:
        raise UserError(
            f"{name}: there is no such file; give a path, -, serial:PORT, soundcard "
            "or soundcard:NAME."
        )
    return Source(settings.rate, partial(_parsed, parser, opened, remedy), timed=kind == "serial")


def _parsed(
    parser: Parser, opened: Callable[[], AbstractContextManager[Read]], remedy: str
) -> Pieces:
    """Yield the samples that a source of bytes sends."""
    failed = "cannot be opened"
    try:
        with opened() as read:
            failed = "broke off"
            while (content := read()) != b"":
                yield parser.feed(content) if content else None
            parser.end()
    except (OSError, OverflowError, ValueError) as error:
        said = reason(getattr(error, "strerror", None) or error)
        raise UserError(f"{parser.name} {failed} ({said}); {remedy}.") from error


@contextmanager
def _open_pipe(path: Path) -> Iterator[Read]:
    """Open standard input (``-``), or a FIFO, device or file of raw samples, without a buffer."""
    standard = str(path) == "-"
    place = standard_input().fileno() if standard else path
    with open(place, "rb", buffering=0, closefd=not standard) as file:
        yield lambda: file.read(PIECE)


@contextmanager
def _open_serial(library: Any, port: str, baud: int) -> Iterator[Read]:  # noqa: ANN401
    """Open a serial port, as microcontrollers have on USB, and forget what was sent before."""
    with library.Serial(port, baud, timeout=WAIT) as line:
        line.reset_input_buffer()
        yield lambda: line.read(max(1, min(line.in_waiting, PIECE))) or None


def _recorded_file(path: Path, name: str, key: str, rate: int | None) -> Source:
    """Read a recording as ``task=predict`` does; its rate has to be known."""
    given = math.nan if rate is None else rate
    samples, source, _ = SignalDecoder(file_rate=given).read(path)
    if math.isnan(source):
        raise _no_rate(name, key)
    if abs(source - given) > RATE_TOLERANCE * source:  # not if none is given
        raise UserError(f"{name} has {source:,.6g} Hz, and {key}.rate is {rate}; leave that out.")
    return Source(round(source), lambda: (piece for piece in [samples.astype("float32")]))


def _sound_card(name: str, device: str, settings: SourceConfig) -> Source:
    """Open a sound card's input by PortAudio: by number or a part of its name, or the system's."""
    sounddevice = _library("sounddevice", name)
    chosen = int(device) if device.isdecimal() else device or None

    @contextmanager
    def failures() -> Iterator[None]:
        try:
            yield
        except (sounddevice.PortAudioError, ValueError) as error:
            raise UserError(
                f"{name} cannot be recorded ({reason(error)}); run python -m sounddevice for the "
                "sound cards that there are, and check its rate and axes."
            ) from error

    def chunks() -> Pieces:
        with failures(), stream:
            while True:
                samples, lost = stream.read(max(1, source.rate // 50))
                source.lost = source.lost or bool(lost)
                yield samples.T.copy()

    with failures():
        properties = sounddevice.query_devices(chosen, "input")
        source = Source(settings.rate or int(properties["default_samplerate"]), chunks)
        stream = sounddevice.InputStream(
            samplerate=source.rate, device=chosen, channels=settings.axes, dtype="float32"
        )
    return source


def _no_rate(name: str, key: str) -> UserError:
    return UserError(f"{name} does not say its rate; give {key}.rate in Hz.")


def _library(module: str, name: str) -> Any:  # noqa: ANN401
    """Import a library of the extra ``live`` where it is needed."""
    try:
        return importlib.import_module(module)
    except (ModuleNotFoundError, OSError) as error:  # sounddevice's of a library of the system
        raise UserError(
            f"{name} needs {module}, which is not installed ({reason(error)}); run: pip install "
            "'tex_lightning[live]' (a sound card also needs PortAudio: apt install libportaudio2)"
        ) from error


FIRST = 5  # pictures that are passed over: exposure settles, and older ones wait in the driver
REMEDY = (
    "check the path, or that the camera is plugged in and no other program has it; camera:1 is "
    "another one"
)


@contextmanager
def open_camera(source: str) -> Iterator[Callable[[], Pixels]]:
    """Open a camera, and yield a function that takes a photo (height, width, 3) of what it sees.

    Args:
        source: ``camera:NUMBER``, or the path or address of a photo, a video or numbered photos
            (``p_%02d.png``), which are gone through one by one.

    Raises:
        UserError: If it cannot be opened, or gives no picture.
    """
    kind, _, number = source.partition(":")
    live = kind == "camera"
    if live and not number.isdecimal():
        raise UserError(f"image={source} names no camera; write camera:0, camera:1 and so on.")
    logging: Any = getattr(cv2.utils, "logging", cv2)  # where OpenCV 5 has it, and where 4 has
    before = logging.setLogLevel(0)
    capture = cv2.VideoCapture(int(number) if live else source)
    logging.setLogLevel(before)
    if not capture.isOpened():
        raise UserError(f"image={source} cannot be opened; {REMEDY}.")

    def photo() -> Pixels:
        for _ in range(FIRST if live else 0):
            capture.grab()
        there, picture = capture.read()
        if not there:
            raise UserError(f"image={source} gives no picture (any more); {REMEDY}.")
        return np.asarray(picture, np.uint8)

    try:
        yield photo
    finally:
        capture.release()
