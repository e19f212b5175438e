"""Reader of ``root/CLASS/haptic/*`` and ``root/CLASS/image/*``: the layout for one's own data."""

from pathlib import Path

from tex_lightning.data.decode import IMAGE_SUFFIXES
from tex_lightning.data.recordings import MODALITIES, Modality, Recording, Recordings, number_files
from tex_lightning.data.trace_files import TRACE_SUFFIXES, axis_files
from tex_lightning.errors import UserError
from tex_lightning.schema import DataConfig

SUFFIXES: dict[Modality, tuple[str, ...]] = {"haptic": TRACE_SUFFIXES, "image": IMAGE_SUFFIXES}


def read(config: DataConfig) -> Recordings:
    """Read ``data.root``; a file's place in the natural order of names is its group."""
    return read_folder(Path(str(config.root)).expanduser())


def own_folder(config: DataConfig) -> Path:
    """``data.root``, or the folder in it that is called like the data set.

    So one ``data.root`` serves a sweep over several data sets.
    """
    root = Path(str(config.root)).expanduser()
    inner = root / config.name
    return inner if inner.is_dir() else root


def read_folder(root: Path) -> Recordings:
    """Read a folder with one folder per class; other files and empty classes are passed over.

    Raises:
        UserError: If the folder is missing or holds no recordings.
    """
    if not root.is_dir():
        raise UserError(f"Folder {root} does not exist; give an existing folder in data.root.")
    rows: list[Recording] = []
    for directory in sorted(path for path in root.iterdir() if path.is_dir()):
        for modality in MODALITIES:
            files = _files(directory / modality, SUFFIXES[modality])
            rows += number_files(directory.name, modality, files)
    if not rows:
        raise UserError(
            f"Folder {root} holds no recordings; put traces in {root}/CLASS/haptic "
            f"({', '.join(TRACE_SUFFIXES)}) and photos in {root}/CLASS/image (.jpg, .png, …)."
        )
    return Recordings(tuple(rows))


def _files(directory: Path, suffixes: tuple[str, ...]) -> list[Path]:
    if not directory.is_dir():
        return []
    return [
        path
        for path in directory.iterdir()
        if path.suffix.lower() in suffixes
        and not path.name.startswith(".")
        and path == axis_files(path)[0]
    ]
