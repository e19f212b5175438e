"""Cache of decoded files: memory-mapped arrays in a folder outside the package.

Each recording has one ``.npy`` file. Its name is a digest of the path, the time of change and the
content of the recording's files, of the decoder's settings and of the part of the file. Entries are
written under another name and then renamed, so no reader sees half an array, and two processes may
decode the same file.
"""

import hashlib
import json
import os
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, overload

import numpy as np
import numpy.typing as npt
import platformdirs
import torch
from torch import Tensor

from tex_lightning.core.console import suppress_warnings
from tex_lightning.core.devices import in_threads
from tex_lightning.core.files import resolved, write_atomically
from tex_lightning.data.decode import Decoded, Decoder, forget_traces
from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import Recording, cut_part
from tex_lightning.errors import UserError, reason
from tex_lightning_runtime.columns import Reading
from tex_lightning_runtime.files import require_file
from tex_lightning_runtime.quality import level
from tex_lightning_runtime.traces import axis_files, map_array

MAX_LINES = 20
NAMED = 5  # files of one reason


class Unusable(NamedTuple):
    """A recording that cannot be decoded, or gives no fragment, and a sentence that says why."""

    recording: Recording
    reason: str


def list_files(unusable: Sequence[Unusable]) -> list[str]:
    """Return a line for each file, and one for many files of one and the same reason."""
    alike: dict[str, list[Unusable]] = {}
    for each in unusable:
        alike.setdefault(each.reason.replace(each.recording.source, ""), []).append(each)
    lines = []
    for those in alike.values():
        first, more = those[0], [each.recording.path.name for each in those[1:NAMED]]
        others = len(those) - NAMED
        also = f", and {others:,} more" if others > 0 else ""
        count = f" The same of {len(those) - 1:,} others: {', '.join(more)}{also}." if more else ""
        lines.append(f"- {first.reason}{count}")
    if len(lines) > MAX_LINES:
        lines[MAX_LINES:] = [f"… and {len(lines) - MAX_LINES} more"]
    return lines


def skipped_entry(unusable: Iterable[Unusable]) -> list[dict[str, str]]:
    """Return the entry of ``results.json`` for the files that were left out."""
    return [{"path": recording.source, "reason": reason} for recording, reason in unusable]


DIGITS = 32  # of a digest; checkpoints keep one for each recording
LAYOUT = 14  # version of the entries: those of another version are decoded again
KEPT = 1 << 17  # entries of which facts stay in memory; an entry never changes
UNREADABLE = (OSError, ValueError, EOFError)  # not there yet, or damaged by a full disk
SIZE = struct.Struct("<Q")  # length of the JSON of a trace, at the end of its entry
T = TypeVar("T")


def cache_root(configured: str | None) -> Path:
    """Return the configured cache folder, else the user's cache folder; make it if it is missing.

    A folder that cannot be written serves as well, as long as it holds all entries.
    """
    root = Path(configured or "~")
    try:
        if not configured:
            root = Path(platformdirs.user_cache_dir("tex_lightning"))
        root = root.expanduser()
        root.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError) as error:  # the second where there is no home folder
        raise _unwritable(root, error) from error
    return root


def _unwritable(root: Path, error: BaseException | None) -> UserError:
    cause = (
        getattr(error, "strerror", None) or error
    )  # of a full disk NumPy has no more than a text
    return UserError(
        f"Cache folder {root} cannot be written ({reason(cause)}); free some space or set "
        "data.cache_dir to a folder that can."
    )


def fingerprint(path: Path) -> str:
    """Return a digest of the content of a recording's files, equal for copies.

    Args:
        path: File of the recording; if each axis has a file, that of any axis.
    """
    digests = []
    for file in axis_files(path):
        require_file(file)
        state = file.stat()
        identity = state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns
        digests.append(_digest(file, identity))
    return hashlib.sha256("".join(digests).encode()).hexdigest()[:DIGITS]


@lru_cache(maxsize=KEPT)
def _digest(file: Path, _: tuple[int, ...]) -> str:
    """Return a digest of a whole file; it is read again if its size or times have changed.

    Both ends of a file would not do: gated recordings begin and end with silence, and scans with a
    white border.
    """
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


class Store:
    """Decoded recordings: signals float32, photos uint8.

    A file that changes after :meth:`fill` is not decoded again while the cache keeps its entry.

    Args:
        root: The cache folder; see :func:`cache_root`.
        decoders: Decoders by modality.
    """

    def __init__(self, root: Path, decoders: Mapping[str, Decoder]) -> None:
        self.root = root / "decoded"
        self.decoders = decoders
        self.entries: dict[Recording, Path] = {}  # of the recordings of the last fill

    def load(self, recording: Recording) -> npt.NDArray[Any]:
        """Return a read-only map: (axes, samples) float32 or (height, width, 3) uint8."""
        return self._read(recording, _map)

    def shape(self, recording: Recording) -> tuple[int, ...]:
        """Return the shape of the array that :meth:`load` gives."""
        return self._read(recording, _shape)

    def extent(self, recording: Recording) -> float:
        """Return how long or large a recording is, in the unit of its decoder."""
        return self.decoders[recording.modality].extent(self.shape(recording))

    def rate(self, recording: Recording) -> float:
        """Return the sampling rate of a trace's file in Hz."""
        return self._read(recording, _facts)[0]

    def level(self, recording: Recording) -> float:
        """Return the level of a trace, see :func:`~tex_lightning_runtime.quality.level`."""
        return self._read(recording, _facts)[1]

    def reading(self, recording: Recording) -> Reading:
        """Return how the file of a trace was read."""
        return self._read(recording, _facts)[2]

    def _read(self, recording: Recording, read: Callable[[Path], T]) -> T:
        """Read from the entry of a recording; decode it if the cache has no complete entry."""
        entry = self._entry(recording)
        try:
            return read(entry)
        except UNREADABLE:
            self._write(entry, self._decode(recording))
            return read(entry)

    def derived(
        self, recording: Recording, key: str, compute: Callable[[], npt.NDArray[Any]]
    ) -> npt.NDArray[Any]:
        """Return a cached result for a recording, or compute and cache it.

        Args:
            recording: Source of the result.
            key: Digest of everything else that the result depends on.
            compute: Function that computes the result; called only if it is not cached.
        """
        entry = self._entry(recording)
        path = entry.with_name(f"{entry.stem}-{key}.npy")
        with suppress(*UNREADABLE):
            return np.array(_map(path))
        array = compute()
        with suppress(UserError):  # a cache that can only be read
            write_atomically(path, lambda partial: _save(partial, Decoded(array)))
        return array

    def fill(self, recordings: Iterable[Recording]) -> list[Unusable]:
        """Decode the recordings that are not in the cache yet, several files at a time.

        Returns:
            The recordings that cannot be decoded, each with the reason.
        """
        try:
            with suppress_warnings():
                return list(filter(None, in_threads(self._try, recordings, "Decoding")))
        finally:
            forget_traces()  # of those that the cache has had

    def _try(self, recording: Recording) -> Unusable | None:
        """Decode a file unless the cache has it; return why it cannot be decoded, else None."""
        try:
            entry = self.entries[recording] = self._identify(recording)
            with suppress(*UNREADABLE):
                _map(entry)
                return None
            decoded = self._decode(recording)
        except UserError as error:
            return Unusable(recording, str(error))
        self._write(entry, decoded)
        return None

    def _entry(self, recording: Recording) -> Path:
        return self.entries.get(recording) or self._identify(recording)

    def _identify(self, recording: Recording) -> Path:
        """Return the path of the entry for the present state of a recording's files."""
        files = axis_files(recording.path)
        identity = {
            "fingerprint": fingerprint(files[0]),  # a copy may bring its time along
            "path": str(resolved(files[0])),
            "changed": [file.stat().st_mtime_ns for file in files],
            "modality": recording.modality,
            "rate": recording.sampling_rate,
            "layout": LAYOUT,
            **vars(self.decoders[recording.modality]),
            "part": recording.part,
        }
        digest = hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()
        return self.root / digest[:2] / f"{digest[2:34]}.npy"

    def _decode(self, recording: Recording) -> Decoded:
        decoder = self.decoders[recording.modality]
        decoded = decoder.decode(recording.path, recording.sampling_rate)
        return decoded._replace(array=cut_part(decoded.array, recording.part, recording.path))

    def _write(self, entry: Path, decoded: Decoded) -> None:
        try:
            write_atomically(entry, lambda path: _save(path, decoded))
        except UserError as error:
            raise _unwritable(self.root.parent, error.__cause__) from error


def _save(path: Path, decoded: Decoded) -> None:
    """Write the array, and behind it rate, level and reading of a trace as JSON."""
    with path.open("wb") as stream:
        np.save(stream, decoded.array, allow_pickle=False)
        if decoded.reading is not None:
            facts = {"rate": decoded.rate, "level": level(decoded.array)}
            written = json.dumps({**facts, **asdict(decoded.reading)}).encode()
            stream.write(written + SIZE.pack(len(written)))


@lru_cache(maxsize=KEPT)  # the opening of a run asks for each a dozen times
def _facts(entry: Path) -> tuple[float, float, Reading]:
    """Read the JSON behind the array of a trace: rate of its file, level, and how it was read."""
    with entry.open("rb") as stream:
        end = stream.seek(-SIZE.size, os.SEEK_END)
        (size,) = SIZE.unpack(stream.read())
        stream.seek(max(0, end - size))
        facts: dict[str, Any] = json.loads(stream.read(min(size, end)))
    lists = {name: tuple(facts[name]) for name in ("axes", "left_out", "notes")}
    reading = Reading(rate_from=facts["rate_from"], **lists)
    return float(facts["rate"]), float(facts["level"]), reading


@lru_cache(maxsize=KEPT)
def _shape(entry: Path) -> tuple[int, ...]:
    return _map(entry).shape


def _map(entry: Path) -> npt.NDArray[Any]:
    """Return the memory-mapped array of an entry.

    Raises:
        OSError: If there is no entry.
        ValueError: If the file is shorter than its header says.
    """
    if not entry.is_file():  # a pipe would be waited for
        raise FileNotFoundError(entry)
    return map_array(entry)


def load_recording(row: Recording, store: Store) -> Tensor:
    """Return a decoded recording, copied to memory."""
    return torch.from_numpy(np.array(store.load(row)))


def load_sample(sample: Sample, store: Store) -> dict[str, Tensor]:
    """Return decoded recordings of a sample by modality, copied to memory."""
    return {name: load_recording(row, store) for name, row in sample.recordings.items()}


@dataclass(frozen=True)
class LazyRecordings(Sequence[T]):
    """Recordings in the form that ``load`` gives them, each loaded when it is looked at.

    A slice is a list of loaded ones.
    """

    rows: Sequence[Recording]
    load: Callable[[Recording], T]

    def __len__(self) -> int:
        """Number of recordings."""
        return len(self.rows)

    @overload
    def __getitem__(self, place: int) -> T: ...
    @overload
    def __getitem__(self, place: slice) -> list[T]: ...
    def __getitem__(self, place: int | slice) -> T | list[T]:
        """Load one of them, or some."""
        if isinstance(place, slice):
            return [*map(self.load, self.rows[place])]
        return self.load(self.rows[place])
