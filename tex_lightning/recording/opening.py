"""From what a person names to the source that it is."""

import sys
from pathlib import Path

from tex_lightning.config.recording import SourceConfig
from tex_lightning.data.trace_files import TRACE_SUFFIXES
from tex_lightning.errors import UserError
from tex_lightning.recording.hardware import SerialSource, SoundCardSource
from tex_lightning.recording.parsing import Float32Parser, Parser, TextParser
from tex_lightning.recording.sources import FileSource, PipeSource, Source, TcpSource, no_rate


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
