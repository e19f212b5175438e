"""What names of folders and files mean: senses, parts and versions of a data set, numbers."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from tex_lightning.data.manifest import MEANT as COLUMNS
from tex_lightning.data.manifest import META
from tex_lightning.data.recordings import MODALITIES, modality_named
from tex_lightning.errors import listed

SPLITS = {
    "train", "training", "val", "valid", "validation", "test", "testing", "eval", "evaluation",
    "dev", "development", "fold",
}  # fmt: skip
ASIDE = SPLITS | {  # folders that are no classes, by their names, as are those that begin with "_"
    "unlabelled", "unlabeled", "results", "outputs", "predictions", "figures", "plots", "code",
    "src", "scripts", "notebooks", "models", "checkpoints", "logs", "docs", "documentation",
    "examples", "demo", "backups", "calibration", "calib", "old", "tmp", "temp", "trash",
    "archive", "archived", "excluded", "discarded", "rejected", "removed",
    "unused", "utils", "venv",
    *META,
}  # fmt: skip
PLAIN = {"raw", "original", "originals", "orig", "unfiltered"}
VERSIONS = PLAIN | {  # of one recording
    "filtered", "filt", "lowpass", "highpass", "bandpass", "smoothed", "denoised", "cleaned",
    "processed", "preprocessed", "normalized", "normalised", "resampled", "downsampled", "cropped",
    "trimmed", "augmented", "flip", "flipped", "mirrored", "rotated", "hdr", "mask", "masks",
    "resized", "thumb", "thumbs", "thumbnail", "edited", "copy", "kopie", "bak", "fft", "psd",
    "spectrum", "spectrogram", "features", "labels", "annotations", "timestamps", "meta",
    "metadata", "info", "notes", "events", "log", "old", "backup",
}  # fmt: skip
FILLERS = {"data", "dataset", "set", "recordings", "samples", "files", "folder", "of"}
READ_ME = {  # text and tables beside recordings, of any suffix
    "license", "metadata", "index", "labels", "manifest",
    "info", "settings", "config", "parameters", "notes", "note", "calibration", "calib",
    "annotation", "annotations", "comments", "description", "protocol", "summary", "changelog",
    "classes", "params", "session_info", "trial_info", "experiment_log",
}  # fmt: skip
ABOUT = {"meta", "metadata", "info", "about", "readme", "license"}  # ends of names of such files
MEANT = {  # names of folders and of modalities that are none of the package's
    **dict.fromkeys(("acc", "accel", "acceleration", "accelerometer", "vibration", "tactile",
                     "touch", "trace", "signal", "movement"), "haptic"),
    **dict.fromkeys(("photo", "picture", "img", "visual", "camera", "rgb"), "image"),
    **dict.fromkeys(("audio", "mic", "microphone"), "sound"),
}  # fmt: skip


def words(name: str) -> list[str]:
    """Divide a name into words and numbers.

    Example:
        >>> from tex_lightning.data.readers.vocabulary import words
        >>> words("Test data/oak_1Raw")
        ['test', 'data', 'oak', '1', 'raw']
    """
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return re.findall(r"[^\W\d_]+|\d+", apart.casefold())


def is_called(name: str, known: set[str]) -> bool:
    """Return whether a name is of these words, beside numbers and words such as ``data``."""
    named = words(name)  # fold alone may be one of cloth
    said = [word for word in named if not word.isdecimal() and word not in FILLERS]
    ones = [word.removesuffix("s") for word in said]
    return bool(said) and all({one, f"{one}s"} & known for one in ones) and named != ["fold"]


def is_about(path: Path) -> bool:
    """Return whether a file is about the recordings beside it, by its name."""
    name = path.stem.casefold()
    named = name in READ_ME or name.replace("_", "").startswith("readme")
    return named or words(path.stem)[-1:] in [[word] for word in ABOUT]


def are(names: Sequence[str], known: set[str]) -> bool:
    """Return whether all names are of these words, if there are any."""
    return bool(names) and all(is_called(name, known) for name in names)


def are_numbered(names: Sequence[str]) -> bool:
    """Return whether names differ in numbers alone, as ``P01`` and ``P02``, and are no classes."""
    shapes = {re.sub(r"^[\da-f]{8,}|\d+", "#", name.casefold()) for name in names}
    numbered = len(shapes) == 1 and all(re.search(r"\d", name) for name in names)
    return numbered and not is_called(names[0], {*COLUMNS["label"]})


def are_people(names: Sequence[str]) -> bool:
    """Return whether names are such as ``P01`` and ``P02`` rather than ``1`` and ``2``."""
    return are_numbered(names) and names[0][:1].isalpha()


def is_sense(part: str) -> bool:
    """Return whether a folder is called as one of the package's senses, or may mean one."""
    return bool(sense_of(part))


def sense_of(part: str) -> str:
    """Return the sense of the package that the name of a folder is, or may mean; else nothing."""
    known = modality_named(part.casefold())
    return known if known in MODALITIES else meant(part)


def meant(name: str) -> str:
    """Return the sense that a name may mean, such as haptic of ``acc``; else nothing."""
    return MEANT.get(name.casefold().removesuffix("s"), "")


def rename(modalities: Iterable[str]) -> str:
    """Say how modalities are called whose names mean others; empty if there are none."""
    told = [f"{name} to {known}" for name in sorted(modalities) if (known := meant(name))]
    return f" Rename {listed(told)} (folders, or the column modality)." if told else ""
