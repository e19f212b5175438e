"""Files that keys of the command line name, as in ``haptic=DIR``, and the samples they make."""

import os
from collections.abc import Mapping
from glob import glob, has_magic
from pathlib import Path

from tex_lightning.data.readers.folder import suffixes_of
from tex_lightning.data.recordings import plural, singular
from tex_lightning.errors import UserError, inflected
from tex_lightning_runtime.files import expanded, is_file, natural_key
from tex_lightning_runtime.traces import stands_for_all


def find_files(modality: str, value: object) -> list[Path]:
    """Return the files that a value of the configuration names, in order.

    Args:
        modality: Which suffixes count in a folder or for a pattern.
        value: A file, a folder, a pattern such as ``DIR/*.wav``, a list of these, or None. What
            exists is taken by its name, even if it could be a pattern.

    Raises:
        UserError: If it is something else, or a folder or pattern gives nothing.
    """
    if value is None:
        return []
    values = value if isinstance(value, list) else [value]
    if not values or any(isinstance(item, dict | list) or item == "" for item in values):
        raise UserError(
            f"{modality}={value} is not a file or a list of files; give {modality}=FILE."
        )
    return [path for item in values for path in _found(modality, str(item))]


def _found(modality: str, value: str) -> list[Path]:
    path = expanded(value)
    if os.path.isdir(path):  # noqa: PTH112  (raises no error for a name that is too long)
        candidates = list(path.iterdir())
    elif has_magic(value) and not is_file(path):
        candidates = [Path(name) for name in glob(str(path), recursive=True)]  # noqa: PTH207
    else:
        return [path]
    files = [path for path in candidates if _readable(path, modality)]
    if not files:
        raise UserError(
            f"{modality}={value} gives no file of a known type; there must be some of "
            f"{', '.join(suffixes_of(modality))}."
        )
    return sorted(files, key=lambda path: natural_key(str(path)))


def _readable(path: Path, modality: str) -> bool:
    """Return whether a path is a file of the modality, or the first of three axis files."""
    known = path.suffix.lower() in suffixes_of(modality) and not path.name.startswith(".")
    return known and is_file(path) and stands_for_all(path)


def match_files(by_modality: Mapping[str, list[Path]]) -> list[dict[str, Path]]:
    """Return samples, each with a file of every modality that is given.

    Where all modalities have the same names without suffixes, each once, these decide; else the
    order does.

    Raises:
        UserError: If there is nothing, or not as many of each.
    """
    files = {modality: paths for modality, paths in by_modality.items() if paths}
    if not files:
        raise UserError("There is nothing to classify; give a file, as in haptic=FILE.")
    if len({len(paths) for paths in files.values()}) > 1:
        counts = " and ".join(
            inflected(len(paths), singular(name), plural(name)) for name, paths in files.items()
        )
        raise UserError(f"There are {counts}; give as many of each.")
    first, *others = files.values()
    by_stem = {name: {path.stem: path for path in paths} for name, paths in files.items()}
    stems = [path.stem for path in first]
    if all(sorted(paths) == sorted(stems) for paths in by_stem.values()):
        return [{name: by_stem[name][stem] for name in files} for stem in stems]
    return [dict(zip(files, paths, strict=True)) for paths in zip(first, *others, strict=True)]
