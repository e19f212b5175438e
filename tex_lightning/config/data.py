"""Where recordings come from, and how they are decoded and divided into folds."""

from dataclasses import dataclass, field
from typing import Any

from tex_lightning.config.keys import SEED, key

SIDES = {"unit": "pixels", "least": 32, "most": 8192}  # of a rendered photo
HERTZ = {"unit": "Hz", "least": 20, "most": 200_000}
HOUR = {"unit": "s", "above": 0, "most": 3600}


@dataclass
class SyntheticConfig:
    """Number and size of the recordings of synthetic surfaces."""

    recordings: int = key("traces, photos and sounds per class", least=1, most=100)
    seed: int = key("seed of the surfaces themselves", least=0, most=SEED)
    seconds: float = key("length of a trace and of its sound", unit="s", least=1, most=600)
    photo_width: int = key("width of a photo", **SIDES)
    photo_height: int = key("height of a photo", **SIDES)


@dataclass
class Folding:
    """How recordings are divided into folds, and which of them are trained on."""

    folds: int = key(
        "number of folds, of whole groups; a group that is a number is in the fold of that number, "
        "modulo this",
        least=2, most=100_000,
    )  # fmt: skip
    test_fold: int | None = key(
        "fold that is tested, never trained or chosen on; with task=evaluate null tests everything"
    )
    val_fold: int | None = key("validation fold of the training; null for none", default=None)
    inverted: bool = key("train on test_fold alone and test on all the others")
    per_class: int | None = key(
        "training recordings of each class and sense, the next ones after test_fold in the order "
        "of groups; null takes all",
        least=1, most=1_000_000, default=None,
    )  # fmt: skip
    test_where: Any = key(
        "conditions whose recordings are tested, and never trained or chosen on, in place of a "
        "fold: {speed: 60} or {speed: [50, 60], light: lamp}",
        default=None,
    )


@dataclass
class DataConfig(Folding):
    """The data set: where recordings are, and how they are decoded and divided into folds."""

    name: str = key("data set, set by data=NAME")
    root: str | None = key("folder of the recordings")
    manifest: str | None = key(
        "CSV with the columns label,modality,path,group; with data=tum the photos' classes"
    )
    reader: dict[str, Any] = key(
        "class that reads the data set, and that class's own keys, set by data=NAME", factory=dict
    )
    group_by: str | None = key(
        "property that defines the groups, where there are several", default=None
    )
    classes: int | None = key(
        "number of classes, the first by name; null takes all", least=2, default=None
    )
    synthetic: SyntheticConfig = field(default_factory=SyntheticConfig)
    sampling_rate: float | None = key(
        "rate that every trace is resampled to; null is their own rate in training (the highest "
        "of several), at most the paper's 10 kHz",
        **HERTZ,
    )
    file_rate: float | None = key(
        "rate of traces without one; null is sampling_rate, or 10 kHz", default=None, **HERTZ
    )
    channels: list[int] | None = key(
        "channels of traces that are kept, counted from 0, such as [3,4,5]; null keeps all",
        least=0, most=63, default=None,
    )  # fmt: skip
    half_scale: bool = key("halve photos; false for photos under a megapixel")
    resize: int | None = key(
        "side of the square that photos are resized to instead",
        unit="pixels", least=1, most=8192, default=None,
    )  # fmt: skip
    hold_out: list[str] | None = key(
        "classes never trained on; tests compare their confidence with that of the others",
        default=None,
    )
    skip_bad: bool = key("continue without unusable files, which are listed and counted")
    cache_dir: str | None = key(
        "folder of decoded files; null is the user's cache folder", default=None
    )
    num_workers: int = key(
        "loader processes; batches are the same for any number", least=0, most=256
    )


@dataclass
class SourceConfig:
    """How the samples of one signal arrive."""

    rate: int | None = key(
        "rate of the samples; null takes that of the file or sound card", default=None, **HERTZ
    )
    axes: int = key("numbers of one sample, each a channel of the file", least=1, most=64)
    format: str = key(
        "samples of pipes and serial ports: little-endian float32, or text, a sample a line",
        choices=("float32", "text"),
    )
    baud: int = key("speed of a serial port", unit="Bd", least=50, most=10_000_000)


@dataclass
class RecordConfig:
    """Recording from sensors into the folder of a class."""

    label: str | None = key("class that is recorded, a folder of record.out", default=None)
    out: str | None = key("folder of the data set, new or existing", default=None)
    seconds: float = key("length of a recording, or its limit", **HOUR)
    least_seconds: float = key(
        "shorter recordings are not kept: after an interrupt, or the end of a source", **HOUR
    )
    count: int = key("number of recordings, one after the other", least=1, most=10_000)
    timeout: float = key("longest time without data of a source", **HOUR)
    conditions: dict[str, Any] = key(
        "further columns of the manifest, such as {speed: 60, person: anna}", factory=dict
    )
    haptic: SourceConfig = field(default_factory=SourceConfig)
    sound: SourceConfig = field(default_factory=SourceConfig)
