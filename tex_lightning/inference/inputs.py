"""Which files ``haptic=`` and ``image=`` name, and which trace belongs to which photo."""

from collections.abc import Sequence
from dataclasses import dataclass
from glob import has_magic
from pathlib import Path

from tex_lightning.data.readers.folder import SUFFIXES
from tex_lightning.data.recordings import Modality, natural_key
from tex_lightning.data.trace_files import axis_files
from tex_lightning.errors import UserError, listed
from tex_lightning.files import matches

Pair = tuple[Path | None, Path | None]


@dataclass(frozen=True)
class Files:
    """Files of one modality.

    Attributes:
        paths: In order.
        searched: Whether a folder or a pattern was searched, so that nobody chose the order.
    """

    paths: tuple[Path, ...] = ()
    searched: bool = False


def find_files(modality: Modality, value: object) -> Files:
    """The files that a value of the configuration names.

    Args:
        modality: Which suffixes count in a folder or for a pattern.
        value: A file, a folder, a pattern such as ``DIR/*.wav``, a list of these, or None. What
            exists is taken by its name, even if it could be a pattern.

    Raises:
        UserError: If it is something else, or a folder or pattern gives nothing.
    """
    if value is None:
        return Files()
    values = value if isinstance(value, list) else [value]
    if not values or any(isinstance(item, dict | list) for item in values):
        raise UserError(
            f"{modality}={value} is not a file or a list of files; give {modality}=FILE."
        )
    found = [_found(modality, str(item)) for item in values]
    paths = tuple(path for files in found for path in files.paths)
    return Files(paths, any(files.searched for files in found))


def _found(modality: Modality, value: str) -> Files:
    path = Path(value).expanduser()
    if path.is_dir():
        candidates = list(path.iterdir())
    elif has_magic(value) and not path.is_file():
        candidates = matches(str(path))
    else:
        return Files((path,))
    files = [each for each in candidates if _readable(each, modality)]
    if not files:
        raise UserError(
            f"{modality}={value} gives no file of a known type; there must be some of "
            f"{', '.join(SUFFIXES[modality])}."
        )
    return Files(tuple(sorted(files, key=lambda each: natural_key(str(each)))), searched=True)


def _readable(path: Path, modality: Modality) -> bool:
    """Whether it is a file of that modality, of three with an axis each the first."""
    known = path.suffix.lower() in SUFFIXES[modality] and not path.name.startswith(".")
    return known and path.is_file() and path == axis_files(path)[0]


def pair_files(traces: Files, photos: Files) -> list[Pair]:
    """Samples of a trace, a photo, or one of each.

    Where a folder or a pattern was searched and both sides have the same names without suffixes,
    each once, these decide; else the order does.

    Raises:
        UserError: If there is nothing, or not as many of each.
    """
    if not traces.paths and not photos.paths:
        raise UserError("There is nothing to classify; give haptic=FILE, image=FILE or both.")
    if not photos.paths:
        return [(trace, None) for trace in traces.paths]
    if not traces.paths:
        return [(None, photo) for photo in photos.paths]
    stems = {photo.stem: photo for photo in photos.paths}
    same = sorted(stems) == sorted(trace.stem for trace in traces.paths)
    if (traces.searched or photos.searched) and same and len(stems) == len(photos.paths):
        return [(trace, stems[trace.stem]) for trace in traces.paths]
    if len(traces.paths) != len(photos.paths):
        raise UserError(
            f"There are {len(traces.paths)} traces and {len(photos.paths)} photos; give as many of "
            f"each{_alone(traces.paths, photos.paths)}."
        )
    return list(zip(traces.paths, photos.paths, strict=True))


def _alone(traces: Sequence[Path], photos: Sequence[Path]) -> str:
    """Name the files whose name the other side lacks, if names are shared at all."""
    names = [{path.stem for path in paths} for paths in (traces, photos)]
    alone = [path.name for path in (*traces, *photos) if path.stem not in names[0] & names[1]]
    return f" ({listed(alone)} has no partner of its name)" if names[0] & names[1] and alone else ""
