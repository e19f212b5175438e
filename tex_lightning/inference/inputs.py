"""Find the files that ``haptic=``, ``image=`` and so on name, and match those of one sample."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from glob import has_magic
from pathlib import Path

from tex_lightning.core.files import is_file, is_folder, matches
from tex_lightning.data.readers.folder import suffixes_of
from tex_lightning.data.recordings import natural_key, plural
from tex_lightning.data.traces import stands_for_all
from tex_lightning.errors import UserError, listed


@dataclass(frozen=True)
class Files:
    """Files of one modality.

    Attributes:
        paths: In order.
        searched: Whether a folder or a pattern was searched, so that the user chose no order.
    """

    paths: tuple[Path, ...] = ()
    searched: bool = False


def find_files(modality: str, value: object) -> Files:
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


def _found(modality: str, value: str) -> Files:
    path = Path(value).expanduser()
    if is_folder(path):
        candidates = list(path.iterdir())
    elif has_magic(value) and not is_file(path):
        candidates = matches(str(path))
    else:
        return Files((path,))
    files = [each for each in candidates if _readable(each, modality)]
    if not files:
        raise UserError(
            f"{modality}={value} gives no file of a known type; there must be some of "
            f"{', '.join(suffixes_of(modality))}."
        )
    return Files(tuple(sorted(files, key=lambda each: natural_key(str(each)))), searched=True)


def _readable(path: Path, modality: str) -> bool:
    """Whether it is a file of that modality, of three with an axis each the first."""
    known = path.suffix.lower() in suffixes_of(modality) and not path.name.startswith(".")
    return known and is_file(path) and stands_for_all(path)


def match_files(given: Mapping[str, Files]) -> list[dict[str, Path]]:
    """Samples, each with a file of every modality that is given.

    Where a folder or a pattern was searched and all modalities have the same names without
    suffixes, each once, these decide; else the order does.

    Raises:
        UserError: If there is nothing, or not as many of each.
    """
    found = {modality: files.paths for modality, files in given.items() if files.paths}
    if not found:
        raise UserError("There is nothing to classify; give a file, as in haptic=FILE.")
    first, *others = found.values()
    stems = {name: {path.stem: path for path in paths} for name, paths in found.items()}
    searched = any(files.searched for files in given.values())
    same = all(set(each) == {path.stem for path in first} for each in stems.values())
    once = all(
        len(each) == len(paths) for each, paths in zip(stems.values(), found.values(), strict=True)
    )
    if searched and same and once:
        return [{name: stems[name][path.stem] for name in found} for path in first]
    if any(len(paths) != len(first) for paths in others):
        counts = " and ".join(f"{len(paths)} {plural(name)}" for name, paths in found.items())
        raise UserError(f"There are {counts}; give as many of each{_alone(list(found.values()))}.")
    return [dict(zip(found, paths, strict=True)) for paths in zip(*found.values(), strict=True)]


def _alone(every: Sequence[Sequence[Path]]) -> str:
    """Name the files whose name others lack, if names are shared at all."""
    names = [{path.stem for path in paths} for paths in every]
    shared = set.intersection(*names)
    alone = [path.name for paths in every for path in paths if path.stem not in shared]
    return f" ({listed(alone)} has no partner of its name)" if shared and alone else ""
