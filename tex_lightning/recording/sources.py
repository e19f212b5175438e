"""Where samples come from: pipes, TCP, files, and by the extra ``live`` serial ports, sound cards.

Bytes of a sensor are parsed strictly: what cannot be meant raises an error that names its place.
"""

import importlib
import re
import socket
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tex_lightning.config.data import SourceConfig
from tex_lightning.data.decode import SignalDecoder, check_samples, read_trace
from tex_lightning.data.traces import TRACE_SUFFIXES
from tex_lightning.errors import UserError, reason, shorten

Chunk = npt.NDArray[np.float32]  # (axes, samples)
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
        """Samples (axes, samples) that are whole now, perhaps none.

        Raises:
            UserError: If they are not of the format, or hold NaN or infinity.
        """
        take = self._lines if self.text else self._floats
        samples = take(self.rest + content).reshape(-1, self.axes).T
        check_samples(samples, self.name, self.count)
        self.count += samples.shape[1]
        return np.ascontiguousarray(samples, dtype=np.float32)

    def end(self) -> None:
        """Refuse an end within a sample; the last line of text may lack its end.

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


class Source(ABC):
    """A signal that comes by and by.

    Attributes:
        rate: Rate in Hz.
        lost: Whether samples were lost on the way.
        timed: Whether samples come when they are taken, so that their rate can be measured.
    """

    rate: int
    lost = False
    timed = False

    @abstractmethod
    def chunks(self) -> Pieces:
        """Samples (axes, samples) as they come, until the end; None now and then if none come.

        What has to be opened is opened here, and closed where the iterator is.

        Raises:
            UserError: If it cannot be opened, or sends what cannot be used.
        """


class ByteSource(Source):
    """Bytes from somewhere, parsed.

    Args:
        parser: Parser of its format; has the name for messages.
        rate: Rate of the samples in Hz.
        place: Its path, address or name.

    Attributes:
        remedy: What to do if it cannot be opened or breaks off.
    """

    remedy = "check the path, and who writes to it"

    def __init__(self, parser: Parser, rate: int, place: str) -> None:
        self.parser, self.rate, self.place = parser, rate, place

    @abstractmethod
    def open(self) -> tuple[Read, Callable[[], object]]:
        """How to read, and how to close."""

    def chunks(self) -> Pieces:
        """As the base class."""
        close: Callable[[], object] | None = None
        try:
            read, close = self.open()
            while (content := read()) != b"":
                yield self.parser.feed(content) if content else None
            self.parser.end()
        except (OSError, OverflowError, ValueError) as error:
            failed = "cannot be opened" if close is None else "broke off"
            said = reason(getattr(error, "strerror", None) or error)
            raise UserError(f"{self.parser.name} {failed} ({said}); {self.remedy}.") from error
        finally:
            if close is not None:
                close()


class PipeSource(ByteSource):
    """Standard input (``-``), or a FIFO, device or file of raw samples."""

    def open(self) -> tuple[Read, Callable[[], object]]:
        """Without a buffer, so that samples are there when they come."""
        standard = self.place == "-"
        file = open(  # noqa: SIM115  (may be a number)
            sys.stdin.fileno() if standard else self.place, "rb", buffering=0, closefd=not standard
        )
        return lambda: file.read(PIECE), file.close


class TcpSource(ByteSource):
    """A server on the network, HOST:PORT, that sends samples to who connects."""

    remedy = "write tcp://HOST:PORT, and check that the sensor listens"
    timeout = 5.0  # seconds for the connection

    def open(self) -> tuple[Read, Callable[[], object]]:
        """Connect."""
        host, _, port = self.place.rstrip("/").rpartition(":")
        connection = socket.create_connection((host, int(port)), self.timeout)
        connection.settimeout(WAIT)

        def read() -> bytes | None:
            try:
                return connection.recv(PIECE)
            except TimeoutError:
                return None

        return read, connection.close


class SerialSource(ByteSource):
    """A serial port, as microcontrollers have on USB, such as ``/dev/ttyUSB0`` or ``COM3``."""

    timed = True
    remedy = "check the name of the port, that it is plugged in, and that no other program has it"
    baud = 115_200  # speed

    def open(self) -> tuple[Read, Callable[[], object]]:
        """Open it and forget what was sent before."""
        port = _library("serial", self.parser.name).Serial(self.place, self.baud, timeout=WAIT)
        port.reset_input_buffer()
        return lambda: port.read(max(1, min(port.in_waiting, PIECE))) or None, port.close


class FileSource(Source):
    """A recording in a file, as ``task=predict`` reads it.

    Args:
        path: The file.
        name: As it was given, for messages.
        key: Section of its settings, such as ``record.haptic``.
        rate: What it is said to have in Hz; None takes what it says.

    Raises:
        UserError: If it cannot be read, or its rate is not stated.
    """

    def __init__(self, path: Path, name: str, key: str, rate: int | None) -> None:
        self.samples, source = read_trace(path, SignalDecoder(), rate)
        if source.source == "assumed":
            raise _no_rate(name, key)
        self.rate = round(source.hz)

    def chunks(self) -> Pieces:
        """As the base class."""
        yield self.samples.astype("float32")


class SoundCardSource(Source):
    """A sound card's input, by PortAudio.

    Args:
        name: As it was given, for messages.
        device: Its number or a part of its name; empty takes the system's own.
        settings: Rate and axes.
    """

    def __init__(self, name: str, device: str, settings: SourceConfig) -> None:
        self.name = name
        sounddevice = _library("sounddevice", name)
        self.failures = (sounddevice.PortAudioError, ValueError)
        given = int(device) if device.isdecimal() else device or None
        try:
            found = sounddevice.query_devices(given, "input")
            self.rate = settings.rate or int(found["default_samplerate"])
            self.stream = sounddevice.InputStream(
                samplerate=self.rate, device=given, channels=settings.axes, dtype="float32"
            )
        except self.failures as error:
            raise self._failed(error) from error

    def chunks(self) -> Pieces:
        """As the base class."""
        try:
            with self.stream:
                while True:
                    samples, lost = self.stream.read(max(1, self.rate // 50))
                    self.lost = self.lost or bool(lost)
                    yield samples.T.copy()
        except self.failures as error:
            raise self._failed(error) from error

    def _failed(self, error: Exception) -> UserError:
        return UserError(
            f"{self.name} cannot be recorded ({reason(error)}); run python -m sounddevice for the "
            "sound cards that there are, and check its rate and axes."
        )


def _no_rate(name: str, key: str) -> UserError:
    return UserError(f"{name} does not say its rate; give {key}.rate in Hz.")


def _library(module: str, name: str) -> Any:  # noqa: ANN401
    """A library of the extra ``live``, imported where it is needed."""
    try:
        return importlib.import_module(module)
    except (ModuleNotFoundError, OSError) as error:  # sounddevice's of a library of the system
        raise UserError(
            f"{name} needs {module}, which is not installed ({reason(error)}); run: pip install "
            "'tex_lightning[live]' (a sound card also needs PortAudio: apt install libportaudio2)"
        ) from error


def open_source(modality: str, given: str, settings: SourceConfig) -> Source:
    """The source that a person names.

    Args:
        modality: The sense, which is also the key.
        given: ``-``, ``tcp://HOST:PORT``, ``serial:PORT``, ``soundcard``, ``soundcard:NAME``, or a
            path.
        settings: Its section.

    Raises:
        UserError: If it is not there or cannot be used, or its rate is missing.
    """
    name, key = f"{modality}={given}", f"record.{modality}"
    kind, _, rest = given.partition(":")
    if kind == "soundcard":
        return SoundCardSource(name, rest, settings)
    path = Path(given).expanduser()
    if path.suffix.lower() in TRACE_SUFFIXES and path.is_file():
        return FileSource(path, name, key, settings.rate)
    if settings.rate is None:
        raise _no_rate(name, key)
    parser, place = Parser(name, key, settings, cut=kind == "serial"), rest.removeprefix("//")
    if kind == "tcp":
        return TcpSource(parser, settings.rate, place)
    if kind == "serial":
        _library("serial", name)
        port = SerialSource(parser, settings.rate, place)
        port.baud = settings.baud
        return port
    if given != "-" and not path.exists():
        raise UserError(
            f"{name}: there is no such file; give a path, -, tcp://HOST:PORT, serial:PORT, "
            "soundcard or soundcard:NAME."
        )
    return PipeSource(parser, settings.rate, given if given == "-" else str(path))
