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
from tex_lightning.errors import UserError, shorten

Chunk = npt.NDArray[np.float32]  # (axes, samples)
SAMPLE = np.dtype("<f4")
LONGEST_LINE = 1000  # bytes; what goes on without a line's end is no text
NUMBERS = set(b"0123456789+-.,;eE# \t\r\n")


class Parser(ABC):
    """Turns pieces of bytes, cut anywhere, into samples.

    Args:
        name: The source as it was given, for messages.
        key: Section of its settings, such as ``record.haptic``.
        axes: Numbers of one sample.
    """

    def __init__(self, name: str, key: str, axes: int) -> None:
        self.name, self.key, self.axes = name, key, axes
        self.rest = b""  # of a sample that is not whole yet
        self.count = 0  # samples so far

    @abstractmethod
    def _take(self, content: bytes) -> npt.NDArray[Any]:
        """Samples (samples, axes) of whole ones in ``content``; keeps the rest."""

    @abstractmethod
    def _expected(self) -> str:
        """What the sensor should send."""

    def feed(self, content: bytes) -> Chunk:
        """Samples (axes, samples) that are whole now, perhaps none.

        Raises:
            UserError: If they are not of the format, or hold NaN or infinity.
        """
        samples = self._take(self.rest + content).T
        check_samples(samples, f"{self.name} ({self._expected()})", self.count)
        self.count += samples.shape[1]
        return np.ascontiguousarray(samples, dtype=np.float32)

    def end(self) -> None:
        """Refuse an end within a sample.

        Raises:
            UserError: If there was one.
        """
        if self.rest.strip():
            raise UserError(f"{self.name} ends within a sample; {self._expected()}.")


class Float32Parser(Parser):
    """Little-endian float32, the axes of a sample one after another, as of ``task=stream``."""

    def _expected(self) -> str:
        return f"send {self.axes} little-endian float32 for each ({self.key}.axes)"

    def _take(self, content: bytes) -> npt.NDArray[Any]:
        if not self.count and len(content) >= SAMPLE.itemsize and NUMBERS.issuperset(content):
            raise UserError(
                f"{self.name} sends text, {shorten(content[:20])}; set {self.key}.format=text."
            )
        size = self.axes * SAMPLE.itemsize
        whole = len(content) - len(content) % size
        self.rest = content[whole:]
        return np.frombuffer(content[:whole], SAMPLE).reshape(-1, self.axes)


class TextParser(Parser):
    """A sample a line, numbers apart by comma, semicolon or white space; # begins a remark.

    Args:
        name: As of the base class.
        key: Likewise.
        axes: Likewise.
        cut: Whether the first line may have begun before we listened, and is passed over.
    """

    def __init__(self, name: str, key: str, axes: int, *, cut: bool = False) -> None:
        super().__init__(name, key, axes)
        self.lines, self.cut = 0, cut

    def _expected(self) -> str:
        return f"print a line with {self.axes} numbers for each ({self.key}.axes)"

    def _take(self, content: bytes) -> npt.NDArray[Any]:
        *lines, self.rest = content.split(b"\n")
        if len(self.rest) > LONGEST_LINE:
            raise UserError(f"{self.name} sends no lines of text; set {self.key}.format=float32.")
        samples = [row for line in lines if (row := self._row(line))]
        return np.array(samples, np.float64).reshape(-1, self.axes)

    def end(self) -> None:
        """As the base class; the last line may lack its end."""
        self.rest = b""

    def _row(self, line: bytes) -> list[float] | None:
        self.lines += 1
        text = line.decode("ascii", "replace").strip().rstrip(",;")
        if (self.cut and self.lines == 1) or not text or text.startswith("#"):
            return None
        try:
            row = [float(field) for field in re.split(r"\s*[,;\s]\s*", text)]
        except ValueError as error:
            raise UserError(
                f"{self.name}, line {self.lines}: {shorten(repr(text))} is no number; "
                f"{self._expected()}, remarks behind #."
            ) from error
        if len(row) != self.axes:
            raise UserError(
                f"{self.name}, line {self.lines}: {shorten(repr(text))} has {len(row)} numbers; "
                f"{self._expected()}."
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

    Attributes:
        remedy: What to do if it cannot be opened or breaks off.
    """

    remedy = "check the path, and who writes to it"

    def __init__(self, parser: Parser, rate: int) -> None:
        self.parser, self.rate = parser, rate

    @abstractmethod
    def open(self) -> tuple[Read, Callable[[], object]]:
        """How to read, and how to close."""

    def chunks(self) -> Pieces:
        """As the base class."""
        try:
            read, close = self.open()
        except (OSError, OverflowError, ValueError) as error:
            raise UserError(
                f"{self.parser.name} cannot be opened ({reason(error)}); {self.remedy}."
            ) from error
        try:
            while (content := read()) != b"":
                yield self.parser.feed(content) if content else None
            self.parser.end()
        except OSError as error:
            raise UserError(
                f"{self.parser.name} broke off ({reason(error)}); {self.remedy}."
            ) from error
        finally:
            close()


class PipeSource(ByteSource):
    """Standard input, or a FIFO, device or file of raw samples.

    Args:
        parser: As of the base class.
        rate: Likewise.
        place: Its path, or the number of an open file.
    """

    def __init__(self, parser: Parser, rate: int, place: str | int) -> None:
        super().__init__(parser, rate)
        self.place = place

    def open(self) -> tuple[Read, Callable[[], object]]:
        """Without a buffer, so that samples are there when they come."""
        file = open(  # noqa: SIM115  (may be a number)
            self.place, "rb", buffering=0, closefd=isinstance(self.place, str)
        )
        return lambda: file.read(PIECE), file.close


class TcpSource(ByteSource):
    """A server on the network that sends samples to who connects.

    Args:
        parser: As of the base class.
        rate: Likewise.
        address: HOST:PORT.
        timeout: Longest wait for the connection in seconds.
    """

    remedy = "check host and port, and that the sensor listens"

    def __init__(self, parser: Parser, rate: int, address: str, timeout: float) -> None:
        super().__init__(parser, rate)
        self.host, _, port = address.rstrip("/").rpartition(":")
        if not self.host or not port.isdecimal():
            raise UserError(f"{parser.name} names no host and port; write tcp://HOST:PORT.")
        self.port, self.timeout = int(port), timeout

    def open(self) -> tuple[Read, Callable[[], object]]:
        """Connect."""
        connection = socket.create_connection((self.host, self.port), self.timeout)
        connection.settimeout(WAIT)

        def read() -> bytes | None:
            try:
                return connection.recv(PIECE)
            except TimeoutError:
                return None

        return read, connection.close


class FileSource(Source):
    """A recording in a file, as ``task=predict`` reads it.

    Args:
        name: As it was given, for messages.
        key: Section of its settings, such as ``record.haptic``.
        path: The file.
        rate: What it is said to have in Hz; None takes what it says.

    Raises:
        UserError: If it cannot be read, or its rate is not stated.
    """

    def __init__(self, name: str, key: str, path: Path, rate: int | None) -> None:
        self.samples, source = read_trace(path, SignalDecoder(), rate)
        if source.source == "assumed":
            raise no_rate(name, key)
        self.rate = round(source.hz)

    def chunks(self) -> Pieces:
        """As the base class."""
        yield self.samples.astype("float32")


def no_rate(name: str, key: str) -> UserError:
    """What to do about a source that says no rate."""
    return UserError(f"{name} does not say its rate; give {key}.rate in Hz.")


def reason(error: Exception) -> str:
    """The cause in a few words on one line."""
    said = getattr(error, "strerror", None) or str(error)
    return " ".join(said.split()).rstrip(".") or type(error).__name__


INSTALL = "pip install 'tex_lightning[live]'"


class SerialSource(ByteSource):
    """A serial port, as microcontrollers have on USB.

    Args:
        parser: As of the base class.
        rate: Likewise.
        port: Its name, such as ``/dev/ttyUSB0`` or ``COM3``.
        baud: Its speed.
    """

    timed = True
    remedy = "check the name of the port, that it is plugged in, and that no other program has it"

    def __init__(self, parser: Parser, rate: int, port: str, baud: int) -> None:
        super().__init__(parser, rate)
        self.port, self.baud = port, baud
        _library("serial", parser.name)

    def open(self) -> tuple[Read, Callable[[], object]]:
        """Open it and forget what was sent before."""
        serial = _library("serial", self.parser.name)
        port = serial.Serial(self.port, self.baud, timeout=WAIT)
        port.reset_input_buffer()
        return lambda: port.read(max(1, min(port.in_waiting, PIECE))) or None, port.close


class SoundCardSource(Source):
    """A sound card's input, by PortAudio.

    Args:
        name: As it was given, for messages.
        device: Its number or a part of its name; empty takes the system's own.
        settings: Rate and axes.
    """

    def __init__(self, name: str, device: str, settings: SourceConfig) -> None:
        self.name, self.axes = name, settings.axes
        sounddevice = _library("sounddevice", name)
        self.failures = (sounddevice.PortAudioError, ValueError)
        given = int(device) if device.isdecimal() else device or None
        try:
            found = sounddevice.query_devices(given, "input")
            self.rate = settings.rate or int(found["default_samplerate"])
            self.stream = sounddevice.InputStream(
                samplerate=self.rate, device=given, channels=self.axes, dtype="float32"
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


def _library(module: str, name: str) -> Any:  # noqa: ANN401
    """A library of the extra ``live``, imported where it is needed."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise UserError(
            f"{name} needs {error.name}, which is not installed; run: {INSTALL}"
        ) from error
    except OSError as error:  # sounddevice's of a missing library of the system
        raise UserError(
            f"{name} needs the library PortAudio, which is not installed; install it with your "
            "system's packages, such as apt install libportaudio2."
        ) from error


def open_source(modality: str, given: str, settings: SourceConfig, timeout: float) -> Source:
    """The source that a person names.

    Args:
        modality: The sense, which is also the key.
        given: ``-``, ``tcp://HOST:PORT``, ``serial:PORT``, ``soundcard``, ``soundcard:NAME``, or a
            path.
        settings: Its section.
        timeout: Longest wait for a connection in seconds.

    Raises:
        UserError: If it is not there or cannot be used, or its rate is missing.
    """
    name, key, axes = f"{modality}={given}", f"record.{modality}", settings.axes
    kind, _, rest = given.partition(":")
    if kind == "soundcard":
        return SoundCardSource(name, rest, settings)
    path = Path(given).expanduser()
    if path.suffix.lower() in TRACE_SUFFIXES and path.is_file():
        return FileSource(name, key, path, settings.rate)
    if settings.rate is None:
        raise no_rate(name, key)
    text = settings.format == "text"
    parser: Parser = Float32Parser(name, key, axes)
    if text:
        parser = TextParser(name, key, axes, cut=kind == "serial")
    if kind == "tcp":
        return TcpSource(parser, settings.rate, rest.removeprefix("//"), timeout)
    if kind == "serial":
        return SerialSource(parser, settings.rate, rest.removeprefix("//"), settings.baud)
    if given != "-" and not path.exists():
        raise UserError(
            f"{name}: there is no such file; give a path, -, tcp://HOST:PORT, serial:PORT, "
            "soundcard or soundcard:NAME."
        )
    return PipeSource(parser, settings.rate, sys.stdin.fileno() if given == "-" else str(path))
