"""Serial ports and sound cards, by the libraries of the extra ``live``."""

import importlib
from collections.abc import Callable
from typing import Any

from tex_lightning.config.recording import SourceConfig
from tex_lightning.errors import UserError
from tex_lightning.recording.parsing import Parser
from tex_lightning.recording.sources import PIECE, WAIT, ByteSource, Pieces, Read, Source, reason

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
