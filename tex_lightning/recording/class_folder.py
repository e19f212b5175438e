"""The folder of a class that grows, and its manifest; every file is whole or not there."""

import os
import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import soundfile

from tex_lightning.data.readers.folder import read_folder, suffixes_of
from tex_lightning.data.recordings import (
    MODALITIES,
    Recording,
    Recordings,
    read_manifest,
    write_manifest,
)
from tex_lightning.errors import UserError
from tex_lightning.files import write_atomically
from tex_lightning.recording.camera import Pixels, encode
from tex_lightning.recording.parsing import Chunk

MANIFEST = "manifest.csv"


class ClassFolder:
    """``ROOT/LABEL``, in the layout of ``data=folder``.

    Args:
        root: Folder of the data set, made when there is something to write.
        label: The class.

    Raises:
        UserError: If one cannot write there, or what is there cannot be read.
    """

    def __init__(self, root: Path, label: str) -> None:
        self.root, self.label = root.resolve(), label
        self.folder, self.manifest = self.root / label, self.root / MANIFEST
        self._check_writable()
        self._check_layout(self.table())

    def table(self) -> Recordings:
        """All recordings of the data set: those of the manifest, or else those in the folder."""
        if self.manifest.is_file():
            table = read_manifest(self.manifest)
            for note in table.notes:
                raise UserError(
                    f"{note.text.rstrip('.')}; they would be lost, so remove them first."
                )
            return table
        suffixes = {each for name in MODALITIES for each in suffixes_of(name)}
        files = (file for depth in ("*/*", "*/*/*") for file in self.root.glob(depth))
        found = any(file.suffix.lower() in suffixes for file in files)
        return read_folder(self.root) if found else Recordings(())

    def next_number(self, table: Recordings) -> int:
        """The first number from 1 that neither a file nor the manifest has yet."""
        named = re.compile(re.escape(self.label) + r"_(\d+)\.[^.]+")
        names = [named.fullmatch(file.name) for file in self.folder.glob("*/*")]
        numbers = [int(match[1]) for match in names if match]
        groups = [row.group + 1 for row in table if row.label == self.label]
        return max([*numbers, *groups], default=0) + 1

    def name(self, number: int) -> str:
        """Of the files of a recording, without suffix."""
        return f"{self.label}_{number:03d}"

    def add(self, signals: Mapping[str, tuple[int, Chunk]], photo: Pixels | None) -> list[Path]:
        """Write one recording, all of it or nothing.

        Args:
            signals: By modality rate in Hz and samples (axes, samples), float32.
            photo: As OpenCV gives it.

        Returns:
            Its files.

        Raises:
            UserError: If they cannot be written.
        """
        table = self.table()
        number = self.next_number(table)
        writers: list[tuple[Recording, Callable[[Path], None]]] = [
            (
                self._row(table, modality, number, ".wav", float(rate)),
                partial(_write_wav, rate, samples),
            )
            for modality, (rate, samples) in signals.items()
        ]
        if photo is not None:
            content = encode(photo)
            writers.append(
                (self._row(table, "image", number, ".jpg"), lambda path: _write(path, content))
            )
        files = [row.path for row, _ in writers]
        grown = Recordings((*table.rows, *(row for row, _ in writers)))
        try:
            for row, write in writers:
                write_atomically(row.path, write)
            write_atomically(self.manifest, lambda path: write_manifest(grown, path))
        except BaseException:
            for file in files:
                file.unlink(missing_ok=True)
            raise
        return files

    def _row(
        self, table: Recordings, modality: str, number: int, suffix: str, rate: float | None = None
    ) -> Recording:
        """One file, in the folder where others of its class and sense are."""
        own = (row.path.parent for row in table.of(modality) if row.label == self.label)
        folder = next((each for each in own if each.parent == self.folder), None)
        path = (folder or self.folder / modality) / f"{self.name(number)}{suffix}"
        return Recording(self.label, modality, path, number - 1, rate)

    def _check_writable(self) -> None:
        """Before anything is recorded; nothing is made yet."""
        there = self.folder
        while not there.exists() and there != there.parent:
            there = there.parent
        if not there.is_dir():
            raise UserError(f"record.out={self.root}: {there} is no folder; name another.")
        if not os.access(there, os.W_OK | os.X_OK):
            raise UserError(
                f"record.out={self.root}: {there} cannot be written to; change its permissions or "
                "name another folder."
            )

    def _check_layout(self, table: Recordings) -> None:
        """Refuse files beside the folders of the senses: they would not be read any more."""
        here = [row for row in table if row.path.parent == self.folder]
        if here:
            raise UserError(
                f"{self.folder} holds recordings side by side, such as {here[0].path.name}; move "
                f"them to {self.folder / here[0].modality} or name another record.out."
            )


def _write_wav(rate: int, samples: Chunk, path: Path) -> None:
    try:
        soundfile.write(path, samples.T, rate, subtype="FLOAT", format="WAV")
    except soundfile.SoundFileError as error:
        raise UserError(
            f"Cannot write {path} ({error}); free some space or choose another folder."
        ) from error


def _write(path: Path, content: bytes) -> None:
    path.write_bytes(content)
