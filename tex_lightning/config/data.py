"""The section ``data`` of the configuration: reader, decoding and folds."""

from typing import Annotated, Any, Literal

from tex_lightning.config.keys import SEED, TEXT, section

HERTZ = "[20, 200000] Hz"
HOUR = "(0, 3600] s"
TimeUnit = Literal["s", "ms", "us", "ns", "min", "h", "d"]
Format = Literal["float32", "text"]  # of samples, little-endian
PIXELS = "[32, 8192] pixels"  # of a rendered photo


@section
class SyntheticConfig:
    """Number and size of the recordings of synthetic surfaces."""

    recordings: Annotated[int, "[1, 100]", "traces, photos and sounds per class"]
    seed: Annotated[int, SEED, "seed of the surfaces themselves"]
    seconds: Annotated[float, "[1, 600] s", "length of a trace and of its sound"]
    photo_width: Annotated[int, PIXELS, "width of a photo"]
    photo_height: Annotated[int, PIXELS, "height of a photo"]


@section
class Folding:
    """The division of recordings into folds, and the folds that are trained and tested on."""

    folds: Annotated[
        int,
        "[2, 100000]",
        "number of folds, at most the groups of a class; a column fold fixes them",
    ]
    test_fold: Annotated[
        int | None,
        "test fold, not used for training or choices; null: fit trains on all, evaluate tests all",
    ]
    val_fold: Annotated[int | None, "validation fold of the training; null for none"] = None
    inverted: Annotated[bool, "train on test_fold alone and test on all the others"]
    per_class: Annotated[
        int | None,
        "[1, 1000000]",
        "training recordings of each class and modality, the next after test_fold; null: all",
    ] = None
    test_where: Annotated[
        Any, TEXT, "conditions of the test set, in place of a fold: {speed: [50, 60], light: lamp}"
    ] = None

    @property
    def withholds(self) -> bool:
        """Whether a training leaves anything out, to be tested on."""
        return self.test_fold is not None or self.test_where is not None


@section
class DataConfig(Folding):
    """The data set: where recordings are, and how they are decoded and divided into folds."""

    name: Annotated[str, "data set, set by data=NAME"]
    root: Annotated[str | None, "folder of the recordings"]
    manifest: Annotated[str | None, "CSV with the columns label,modality,path,group"]
    reader: Annotated[dict[str, Any], "class that reads the data set, and its keys"]
    group_by: Annotated[str | None, "property that defines the groups, if several"] = None
    classes: Annotated[
        int | None, "[2, inf)", "number of classes, the first by name; null: all"
    ] = None
    synthetic: SyntheticConfig
    sampling_rate: Annotated[
        float | None, HERTZ, "rate of every trace; null: the highest of their own, at most 10 kHz"
    ]
    file_rate: Annotated[
        float | None, HERTZ, "rate of traces without one; null: sampling_rate, or 10 kHz"
    ] = None
    channels: Annotated[
        list[Any] | None,
        "[0, 63]",
        "channels of traces that are kept: names of columns, or numbers from 0; null: all",
    ] = None
    time_unit: Annotated[
        str | None,
        TimeUnit,
        "unit of times in tables, such as ms; null: what name or row of units says",
    ] = None
    half_scale: Annotated[bool, "halve photos; false for photos under a megapixel"]
    resize: Annotated[int | None, "[1, 8192] pixels", "side of square photos"] = None
    hold_out: Annotated[
        list[str] | None, "classes left out of training and tested as unknown ones"
    ] = None
    skip_bad: Annotated[bool, "continue without unusable files, which are listed and counted"]
    cache_dir: Annotated[str | None, "folder of decoded files; null: the user's cache"] = None
    num_workers: Annotated[int, "[0, 256]", "loader processes; batches are the same for any number"]


@section
class SourceConfig:
    """How the samples of one signal arrive."""

    rate: Annotated[int | None, HERTZ, "rate; null takes that of the file or card"] = None
    axes: Annotated[int, "[1, 64]", "values of one sample, each a channel of the file"]
    format: Annotated[
        str, Format, "samples of pipes and serial ports: float32, or text, a sample a line"
    ]
    baud: Annotated[int, "[50, 10000000] Bd", "speed of a serial port"]


@section
class RecordConfig:
    """Recording from sensors into the folder of a class."""

    label: Annotated[str | None, "class that is recorded, a folder of record.out"] = None
    out: Annotated[str | None, "folder of the data set, new or existing"] = None
    seconds: Annotated[float, HOUR, "length of a recording"]
    count: Annotated[int, "[1, 10000]", "number of recordings, one after the other"]
    timeout: Annotated[float, HOUR, "longest time without data of a source"]
    conditions: Annotated[
        dict[str, Any], TEXT, "further columns of the manifest, as {speed: 60, person: anna}"
    ]
    haptic: SourceConfig
    sound: SourceConfig
