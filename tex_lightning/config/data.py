"""Where recordings come from, and how they are decoded and divided into folds."""

from dataclasses import dataclass, field
from typing import Any

from tex_lightning.config.keys import SEED, key

HERTZ = {"range": "[20, 200000]", "unit": "Hz"}
HOUR = {"range": "(0, 3600]", "unit": "s"}
TIME_UNITS = ("s", "ms", "us", "ns", "min", "h", "d")
FORMATS = ("float32", "text")  # of samples, little-endian
PIXELS = {"range": "[32, 8192]", "unit": "pixels"}  # of a rendered photo


@dataclass
class SyntheticConfig:
    """Number and size of the recordings of synthetic surfaces."""

    recordings: int = key("traces, photos and sounds per class", "[1, 100]")
    seed: int = key("seed of the surfaces themselves", SEED)
    seconds: float = key("length of a trace and of its sound", "[1, 600]", unit="s")
    photo_width: int = key("width of a photo", **PIXELS)
    photo_height: int = key("height of a photo", **PIXELS)


@dataclass
class Folding:
    """How recordings are divided into folds, and which of them are trained on."""

    folds: int = key(
        "number of folds, at most the groups of a class; a column fold fixes them", "[2, 100000]"
    )
    test_fold: int | None = key(
        "test fold, not used for training or choices; null: fit trains on all, evaluate tests all"
    )
    val_fold: int | None = key("validation fold of the training; null for none", default=None)
    inverted: bool = key("train on test_fold alone and test on all the others")
    per_class: int | None = key(
        "training recordings of each class and modality, the next after test_fold; null: all",
        "[1, 1000000]",
        default=None,
    )
    test_where: Any = key(
        "conditions of the test set, in place of a fold: {speed: [50, 60], light: lamp}",
        default=None,
        text=True,
    )

    @property
    def withholds(self) -> bool:
        """Whether a training leaves anything out, to be tested on."""
        return self.test_fold is not None or self.test_where is not None


@dataclass
class DataConfig(Folding):
    """The data set: where recordings are, and how they are decoded and divided into folds."""

    name: str = key("data set, set by data=NAME")
    root: str | None = key("folder of the recordings")
    manifest: str | None = key("CSV with the columns label,modality,path,group")
    reader: dict[str, Any] = key("class that reads the data set, and its keys", factory=dict)
    group_by: str | None = key("property that defines the groups, if several", default=None)
    classes: int | None = key(
        "number of classes, the first by name; null: all", "[2, inf)", default=None
    )
    synthetic: SyntheticConfig = field(default_factory=SyntheticConfig)
    sampling_rate: float | None = key(
        "rate of every trace; null: the highest of their own, at most 10 kHz", **HERTZ
    )
    file_rate: float | None = key(
        "rate of traces without one; null: sampling_rate, or 10 kHz", default=None, **HERTZ
    )
    channels: list[Any] | None = key(
        "channels of traces that are kept: names of columns, or numbers from 0; null: all",
        "[0, 63]",
        default=None,
    )
    time_unit: str | None = key(
        "unit of times in tables, such as ms; null: what name or row of units says",
        choices=TIME_UNITS,
        default=None,
    )
    half_scale: bool = key("halve photos; false for photos under a megapixel")
    resize: int | None = key("side of square photos", "[1, 8192]", unit="pixels", default=None)
    hold_out: list[str] | None = key(
        "classes left out of training and tested as unknown ones", default=None
    )
    skip_bad: bool = key("continue without unusable files, which are listed and counted")
    cache_dir: str | None = key("folder of decoded files; null: the user's cache", default=None)
    num_workers: int = key("loader processes; batches are the same for any number", "[0, 256]")


@dataclass
class SourceConfig:
    """How the samples of one signal arrive."""

    rate: int | None = key("rate; null takes that of the file or card", default=None, **HERTZ)
    axes: int = key("values of one sample, each a channel of the file", "[1, 64]")
    format: str = key(
        "samples of pipes and serial ports: float32, or text, a sample a line", choices=FORMATS
    )
    baud: int = key("speed of a serial port", "[50, 10000000]", unit="Bd")


@dataclass
class RecordConfig:
    """Recording from sensors into the folder of a class."""

    label: str | None = key("class that is recorded, a folder of record.out", default=None)
    out: str | None = key("folder of the data set, new or existing", default=None)
    seconds: float = key("length of a recording", **HOUR)
    count: int = key("number of recordings, one after the other", "[1, 10000]")
    timeout: float = key("longest time without data of a source", **HOUR)
    conditions: dict[str, Any] = key(
        "further columns of the manifest, as {speed: 60, person: anna}", factory=dict, text=True
    )
    haptic: SourceConfig = field(default_factory=SourceConfig)
    sound: SourceConfig = field(default_factory=SourceConfig)
