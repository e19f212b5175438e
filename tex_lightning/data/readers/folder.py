"""Readers of one's own data: a folder for each class, or a CSV manifest for any other layout.

The folder holds ``root/CLASS/haptic/*`` and ``root/CLASS/image/*``. Names of folders may be in any
case and in the plural (``Haptics``). ``root/CLASS/sound/*`` and the folders of senses of the user's
own, ``root/CLASS/NAME/*``, are read as well. A class without folders for its senses is read as it
lies, ``root/CLASS/*``: a file's suffix tells its sense.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tex_lightning.data.decode import IMAGE_SUFFIXES
from tex_lightning.data.rates import RATES_TABLE
from tex_lightning.data.recordings import (
    MODALITIES,
    Note,
    Recording,
    Recordings,
    number_files,
    read_manifest,
)
from tex_lightning.data.trace_files import TRACE_SUFFIXES as DECODED
from tex_lightning.data.trace_files import axis_paths
from tex_lightning.errors import UserError

# without .xml, which beside photos are mostly their annotations; a manifest may name such traces
TRACE_SUFFIXES = tuple(suffix for suffix in DECODED if suffix != ".xml")
# of files that lie side by side in the folder of a class
SUFFIXES = {"haptic": TRACE_SUFFIXES, "image": IMAGE_SUFFIXES}
# of files in the folder of a sense; that of a user's sense may hold either
OWN_SUFFIXES = {**SUFFIXES, "sound": TRACE_SUFFIXES}
# what haptic, image and sound are called by mistake: no senses of the user's own
MISNOMERS = ("accel", "acceleration", "audio", "photo", "picture", "trace")
SHOWN = 3  # names of a folder that nothing was read from


@dataclass
class FolderReader:
    """One's own data.

    Attributes:
        root: Folder with a folder for each class.
    """

    root: str

    def read(self) -> Recordings:
        """Read the folder; a file's place in the natural order of names is its group."""
        return read_folder(Path(self.root).expanduser())


def class_folders(root: str, name: str) -> list[Path]:
    """Folders in ``root``, or in the folder in it that is called like the data set.

    So one ``data.root`` serves a sweep over several data sets.

    Raises:
        UserError: If there is no such folder.
    """
    folder = Path(root).expanduser()
    if not folder.is_dir():
        raise UserError(f"Folder {root} does not exist; data.root must hold one folder per class.")
    inner = folder / name
    return _folders(inner if inner.is_dir() else folder)


def read_folder(root: Path) -> Recordings:
    """Read a folder with one folder per class; what is passed over is in the table's notes.

    Raises:
        UserError: If the folder is missing or holds no recordings, or a class has two folders for
            one sense.

    Example:
        >>> import tex_lightning as tl
        >>> from pathlib import Path
        >>> table = tl.read_folder(Path("DIR"))
        >>> table.classes, len(table.of("haptic"))
        (['alpha', 'beta', 'gamma'], 30)
    """
    if not root.is_dir():
        raise UserError(f"Folder {root} does not exist; give an existing folder in data.root.")
    rows: list[Recording] = []
    notes: list[Note] = []
    for directory in sorted(root.iterdir()):
        if directory.is_dir() and not directory.name.startswith("."):
            found, passed_over = _read_class(directory)
            rows += found
            notes += passed_over
    if not rows:
        raise UserError(
            f"Folder {root} holds no recordings; put traces in {root}/CLASS/haptic "
            f"({', '.join(TRACE_SUFFIXES)}) and photos in {root}/CLASS/image (.jpg, .png, …)."
        )
    return Recordings(tuple(rows), tuple(notes))


def _read_class(directory: Path) -> tuple[list[Recording], list[Note]]:
    """Recordings of one class, from its folders if it has any, and what was passed over."""
    folders, own = _sense_folders(directory), _own_folders(directory)
    places = {**(folders or dict.fromkeys(SUFFIXES, directory)), **own}
    files = {sense: _files(place, suffixes_of(sense)) for sense, place in places.items()}
    rows = [
        row for sense, paths in files.items() for row in number_files(directory.name, sense, paths)
    ]
    return rows, list(_passed_over(directory, folders, files))


def _passed_over(
    directory: Path, folders: dict[str, Path], files: dict[str, list[Path]]
) -> Iterator[Note]:
    if not any(files.values()):
        yield Note("class folder", 1, f"Class folder {directory} is skipped: {_why(directory)}.")
    else:
        for sense, folder in folders.items():
            if not files[sense]:
                yield Note("folder", 1, f"Folder {folder} is skipped: {_why(folder)}.")
    stray = [file for suffixes in SUFFIXES.values() for file in _files(directory, suffixes)]
    if folders and stray:
        listed = _listed([file.name for file in stray])
        text = f"{directory} has folders for its senses, so {listed} beside them is not read."
        yield Note("stray file", len(stray), text)


def _why(folder: Path) -> str:
    """Why nothing was read in a folder."""
    names = [path.name for path in sorted(folder.iterdir())]
    if not names:
        return "it is empty"
    return f"there is no trace and no photo in it or in its haptic and image ({_listed(names)})"


def _listed(names: list[str]) -> str:
    return ", ".join([*names[:SHOWN], *(["…"] if len(names) > SHOWN else [])])


def suffixes_of(modality: str) -> tuple[str, ...]:
    """Suffixes of the files of a modality, in lower case."""
    return OWN_SUFFIXES.get(modality, (*TRACE_SUFFIXES, *IMAGE_SUFFIXES))


def _sense_folders(directory: Path) -> dict[str, Path]:
    """Folders of the package's senses, by modality."""
    found: dict[str, Path] = {}
    for modality in MODALITIES:
        folders = [each for each in _folders(directory) if _is_called(each, modality)]
        if len(folders) > 1:
            raise UserError(
                f"{directory} has the folders {folders[0].name} and {folders[1].name} for one "
                "sense; put their files into one."
            )
        if folders:
            found[modality] = folders[0]
    return found


def _own_folders(directory: Path) -> dict[str, Path]:
    """Folders of the user's own senses, by name: all other folders with recordings."""
    return {
        folder.name.casefold(): folder
        for folder in _folders(directory)
        if folder.name.isidentifier()
        and not any(_is_called(folder, name) for name in (*MODALITIES, *MISNOMERS))
        and _files(folder, suffixes_of(folder.name))
    }


def _folders(directory: Path) -> list[Path]:
    return sorted(path for path in directory.iterdir() if path.is_dir())


def _is_called(folder: Path, name: str) -> bool:
    return folder.name.casefold() in (name, f"{name}s")


def _files(directory: Path, suffixes: tuple[str, ...]) -> list[Path]:
    return [
        path
        for path in sorted(directory.iterdir())
        if path.suffix.lower() in suffixes
        and not path.is_dir()
        and not path.name.startswith(".")
        and path.name.casefold() != RATES_TABLE
        and path == axis_paths(path)[0]
    ]


@dataclass
class ManifestReader:
    """A table.

    Attributes:
        manifest: Its file.
    """

    manifest: str

    def read(self) -> Recordings:
        """Read the table."""
        return read_manifest(Path(self.manifest).expanduser())
