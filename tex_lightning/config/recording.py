"""Sensors that ``task=record`` reads, and the data set that it adds to."""

from dataclasses import dataclass, field
from typing import Any

from tex_lightning.config.keys import key


@dataclass
class SourceConfig:
    """How the samples of one signal arrive."""

    rate: int | None = key(
        "rate of the samples; null takes that of the file or of the sound card",
        unit="Hz", least=1, most=10_000_000, default=None,
    )  # fmt: skip
    axes: int = key("numbers of one sample, each a channel of the file", choices=(1, 3))
    format: str = key(
        "samples of pipes, TCP and serial ports: little-endian float32, or text, a sample a line",
        choices=("float32", "text"),
    )
    baud: int = key("speed of a serial port", unit="Bd", least=50, most=10_000_000)


@dataclass
class RecordConfig:
    """Recording from sensors into the folder of a class."""

    label: str | None = key("class that is recorded, a folder of record.out", default=None)
    out: str | None = key("folder of the data set, new or existing", default=None)
    seconds: float = key("length of a recording, or its limit", unit="s", above=0, most=3600)
    least_seconds: float = key(
        "shorter recordings are not kept: after an interrupt, a tap, or the end of a source",
        unit="s", above=0, most=3600,
    )  # fmt: skip
    count: int = key("number of recordings, one after the other", least=1, most=10_000)
    contact: bool = key(
        "begin each when the level rises above that of the first half second, and end it when it "
        "falls silent"
    )
    timeout: float = key("longest time without data of a source", unit="s", above=0, most=3600)
    conditions: dict[str, Any] = key(
        "further columns of the manifest, such as {speed: 60, person: anna}", factory=dict
    )
    haptic: SourceConfig = field(default_factory=SourceConfig)
    sound: SourceConfig = field(default_factory=SourceConfig)
