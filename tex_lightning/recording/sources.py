"""What samples come from without any library: pipes, TCP and files of recordings."""

import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator
from pathlib import Path

from tex_lightning.data.decode import SignalDecoder, read_trace
from tex_lightning.errors import UserError
from tex_lightning.recording.parsing import Chunk, Parser

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
