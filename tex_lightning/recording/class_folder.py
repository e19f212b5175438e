"""Write recordings and photos into the folder of a class, with its manifest."""

import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import cv2
import soundfile

from tex_lightning.core.files import write_atomically
from tex_lightning.core.run_folder import locked_folder
from tex_lightning.data.manifest import KNOWN, read_manifest, write_manifest
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.errors import UserError
from tex_lightning.recording.sources import Chunk, Pixels

MANIFEST = "manifest.csv"
QUALITY = 95  # of JPEG, 0 to 100
PATIENCE = 60.0  # seconds that another process may take to write a recording


class ClassFolder:
    """``ROOT/LABEL``, in the layout of ``data=folder``.

    Args:
        root: Folder of the data set, made when there is something to write.
        label: The class.
        conditions: Under which it is recorded, columns of the manifest.

    Raises:
        UserError: If what is there cannot be read, or lies side by side.
    """

    def __init__(self, root: Path, label: str, conditions: Mapping[str, object]) -> None:
        self.root, self.label = root.resolve(), label
        self.folder, self.manifest = self.root / label, self.root / MANIFEST
        given = [(name, str(value)) for name, value in conditions.items() if value is not None]
        self.conditions = tuple(given)
        for name in conditions:
            if name in KNOWN:
                raise UserError(f"record.conditions: {name} is a column of its own; rename it.")
        if here := [row for row in self.table() if row.path.parent == self.folder]:
            raise UserError(
                f"{self.folder} holds recordings side by side, such as {here[0].path.name}; move "
                f"them to {self.folder / here[0].modality} or name another record.out."
            )

    def table(self) -> Recordings:
        """Return the recordings of the manifest, or else those in the folder."""
        if self.manifest.is_file():
            return read_manifest(self.manifest)
        try:
            return read_folder(self.root)
        except UserError:  # nothing is there yet
            return Recordings(())

    def next_name(self) -> str:
        """Return the file name of the next recording, without suffix; its number is the largest."""
        named = re.compile(re.escape(self.label) + r"_(\d+)\.[^.]+")
        names = [named.fullmatch(file.name) for file in self.folder.glob("*/*")]
        number = max((int(match[1]) for match in names if match), default=0) + 1
        return f"{self.label}_{number:03d}"

    def add(self, signals: Mapping[str, tuple[int, Chunk]], photo: Pixels | None) -> list[Path]:
        """Write one recording, all of it or nothing, while no other process does.

        Args:
            signals: By modality rate in Hz and samples (axes, samples), float32.
            photo: Photo in OpenCV's layout.

        Returns:
            Its files.

        Raises:
            UserError: If they cannot be written.
        """
        with locked_folder(self.root, "record.out", patience=PATIENCE):
            return self._add(signals, photo)

    def _add(self, signals: Mapping[str, tuple[int, Chunk]], photo: Pixels | None) -> list[Path]:
        table, name = self.table(), self.next_name()
        counted = re.compile(rf"(?:{re.escape(self.label)}/)?(\d+)")  # by the reader of folders
        groups = [counted.fullmatch(row.group_key) for row in table if row.label == self.label]
        group = f"{self.label}/{max((int(match[1]) for match in groups if match), default=-1) + 1}"
        writers: dict[Recording, Callable[[Path], object]] = {}
        for modality, (rate, samples) in signals.items():
            path = self.folder / modality / f"{name}.wav"
            row = Recording(self.label, modality, path, group, float(rate), self.conditions)
            writers[row] = partial(_write_wav, rate, samples)
        if photo is not None:
            path = self.folder / "image" / f"{name}.jpg"
            row = Recording(self.label, "image", path, group, conditions=self.conditions)
            writers[row] = partial(_write_jpeg, photo)
        try:
            for row, write in writers.items():
                write_atomically(row.path, write)
            grown = Recordings((*table.rows, *writers))
            write_atomically(self.manifest, partial(write_manifest, grown))
        except BaseException:
            for row in writers:
                row.path.unlink(missing_ok=True)
            raise
        return [row.path for row in writers]


def _write_jpeg(photo: Pixels, path: Path) -> None:
    _, content = cv2.imencode(".jpg", photo, (cv2.IMWRITE_JPEG_QUALITY, QUALITY))
    path.write_bytes(content.tobytes())


def _write_wav(rate: int, samples: Chunk, path: Path) -> None:
    try:
        soundfile.write(path, samples.T, rate, subtype="FLOAT", format="WAV")
    except soundfile.SoundFileError as error:
        raise UserError(
            f"Cannot write {path} ({error}); free some space or choose another folder."
        ) from error
