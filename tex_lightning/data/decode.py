"""Decode a file to an array; a damaged file raises an error.

A checkpoint keeps the settings of its decoders, so a prediction decodes as the training did. Traces
that are read to learn their rate are kept in memory until they are decoded at it.
"""

import logging
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Annotated, Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np
import numpy.typing as npt
from PIL import Image

from tex_lightning.config.signatures import misfits
from tex_lightning.core.console import log_once
from tex_lightning.errors import UserError
from tex_lightning_runtime.columns import Reading
from tex_lightning_runtime.files import is_file
from tex_lightning_runtime.photos import IMAGE_SUFFIXES, read_photo
from tex_lightning_runtime.pixels import halve, middle
from tex_lightning_runtime.resampling import MAX_RATE, MIN_RATE, to_rate
from tex_lightning_runtime.samples import MAX_AXES, Channels, check_samples
from tex_lightning_runtime.times import UNITS
from tex_lightning_runtime.traces import TRACE_SUFFIXES, read_samples

RATE_TOLERANCE = 0.01  # relative difference allowed between a stated rate and the file's own
SLOW_RATE = 500.0  # Hz; below it a signal's level and direction tell much: pressure, gravity
ASSUMED = "an assumption"
RATES = f"[{MIN_RATE:g}, {MAX_RATE:g}]"
log = logging.getLogger(__name__)
Array = npt.NDArray[Any]
Photo = npt.NDArray[np.uint8]


class Decoded(NamedTuple):
    """A decoded file: samples or pixels, and of a signal the file's rate in Hz and its reading."""

    array: Array
    rate: float | None = None
    reading: Reading | None = None


class SourceSignal(NamedTuple):
    """A signal at the rate of its file: samples (axes, samples), rate in Hz, and its reading."""

    samples: npt.NDArray[np.floating]
    rate: float
    reading: Reading = Reading(rate_from="its format")


@dataclass(frozen=True)
class SignalDecoder:
    """Decoder of signals: traces and sounds, (axes, samples) float32.

    Attributes:
        sampling_rate: Rate in Hz that every signal is brought to.
        file_rate: Rate in Hz of signals whose file and reader give none.
        channels: Channels of a sound, or columns of a table beside its time, that are kept: names,
            or numbers counted from 0; None keeps all.
        time_unit: Unit of times in tables that do not say it, such as ``ms``.
        assumes: Whether ``file_rate`` is only assumed, since nobody has given it.
    """

    sampling_rate: Annotated[float, RATES] = 10_000.0
    file_rate: Annotated[float, RATES] = 10_000.0
    channels: tuple[int | str, ...] | None = None
    time_unit: str | None = None
    assumes: bool = False

    suffixes: ClassVar[tuple[str, ...]] = TRACE_SUFFIXES
    unit: ClassVar[str] = "s"

    def __post_init__(self) -> None:
        if self.channels is not None and not _are_channels(self.channels):
            raise UserError(
                f"data.channels is {self.channels!r}; give different names of columns, numbers "
                f"from 0 to {MAX_AXES - 1}, or null."
            )
        if self.time_unit is not None and self.time_unit not in UNITS:
            raise UserError(
                f"data.time_unit is {self.time_unit!r}; choose ms, us, ns, s, min, h, d or null."
            )

    def decode(self, path: Path, rate: float | None = None) -> Decoded:
        """Read a trace and resample it to :attr:`sampling_rate`.

        Args:
            path: A file as :func:`~tex_lightning_runtime.traces.read_samples` reads it.
            rate: Rate of this file in Hz if the manifest or the reader knows it.

        Returns:
            Samples (axes, samples) float32, in the file's unit and with its level; the file's own
            rate in Hz; and how the file was read.

        Raises:
            UserError: If the file is missing, empty, damaged, of another shape, or holds NaN, or if
                it states another rate.
        """
        samples, source, reading = self.read(path, rate)
        trace = to_rate(samples, source, self.sampling_rate, f"Trace {path}")
        return Decoded(trace, source, reading)

    def read(self, path: Path, rate: float | None = None) -> SourceSignal:
        """Read a trace at the rate of its file; a decoder of another format replaces this method.

        The rate is that of the file's header or column of time, else ``rate``, else
        :attr:`file_rate`. Arguments and errors are those of :meth:`decode`.
        """
        samples, source, reading = read_once(read_samples, path, self.channels, self.time_unit)
        check_samples(samples, f"Trace {path}")
        if source is None and rate is not None:
            return SourceSignal(samples, rate, replace(reading, rate_from="the manifest or reader"))
        if source is None:
            origin = f"{ASSUMED} (data.file_rate=HZ gives it)" if self.assumes else "data.file_rate"
            return SourceSignal(samples, self.file_rate, replace(reading, rate_from=origin))
        if rate is not None and not math.isclose(source, rate, rel_tol=RATE_TOLERANCE):
            raise UserError(
                f"Trace {path} has {source:,.6g} Hz by its header or column of time, but "
                f"{rate:,.6g} Hz by the manifest or reader; correct or remove one of them."
            )
        return SourceSignal(samples, source, reading)

    def assuming(
        self,
        rate: float | None,
        channels: Channels = None,
        time_unit: str | None = None,
    ) -> Self:
        """Return the decoder with the given rate in Hz and columns of files; None keeps its own."""
        given = self if rate is None else replace(self, file_rate=rate, assumes=False)
        if channels is not None:
            given = replace(given, channels=tuple(channels))
        return given if time_unit is None else replace(given, time_unit=time_unit)

    def extent(self, shape: Sequence[int]) -> float:
        """Return the length of a signal (axes, samples) in :attr:`unit`."""
        return float(shape[1] / self.sampling_rate)


@dataclass(frozen=True)
class PhotoDecoder:
    """Decoder of photos, (height, width, 3) uint8.

    Attributes:
        half_scale: Whether they are halved (the paper's preprocessing, section III-B).
        resize: Side in pixels of the square that they are brought to; None leaves their size.
    """

    half_scale: bool = True
    resize: Annotated[int, "[1, 8192]"] | None = None

    suffixes: ClassVar[tuple[str, ...]] = IMAGE_SUFFIXES
    unit: ClassVar[str] = "megapixels"

    def decode(self, path: Path, rate: float | None = None) -> Decoded:
        """Read a photo as RGB, upright, halved or resized if so configured.

        Args:
            path: An image file.
            rate: Ignored for a photo.

        Returns:
            Pixels (height, width, 3) uint8; a photo has no rate.

        Raises:
            UserError: If the file is missing, empty, truncated by more than a little, or no image.
        """
        photo, notes = read_photo(path)
        for note in notes:
            said = f"Image {path}: {note} (said of the first such image)."
            log_once(log, said, logging.WARNING, key=note)
        return Decoded(self.scale(photo, f"Image {path}"))

    def scale(self, photo: Photo, name: str) -> Photo:
        """Halve or resize a photo (height, width, 3).

        A photo that is not resized is cropped to its middle where it exceeds 16.8 megapixels.

        Raises:
            UserError: If there is too little to be halved, beginning with ``name``.
        """
        if self.resize is not None:
            square = self.resize, self.resize
            return np.array(Image.fromarray(photo).resize(square, Image.Resampling.BILINEAR))
        kept = middle(photo, 2 if self.half_scale else 1, name)
        return halve(kept) if self.half_scale else kept

    def assuming(
        self, rate: float | None, channels: Channels = None, time_unit: str | None = None
    ) -> Self:
        """Return the decoder itself; photos have neither rate nor columns."""
        return self

    def extent(self, shape: Sequence[int]) -> float:
        """Return the size of a photo (height, width, 3) in :attr:`unit`."""
        return float(shape[0] * shape[1] / 1e6)


Decoder = SignalDecoder | PhotoDecoder  # its fields decide the content of the arrays
DECODERS: dict[str, type[Decoder]] = {"signal": SignalDecoder, "photo": PhotoDecoder}


def check_decoding(where: str, medium: str, settings: Mapping[str, Any]) -> None:
    """Reject settings that the decoder of a medium does not take, before anything is decoded.

    Args:
        where: Key of the settings.
        medium: ``signal`` or ``photo``.
        settings: Fields of the decoder; null stands for its default.

    Raises:
        UserError: Naming all of them.
    """
    chosen = {name: value for name, value in settings.items() if value is not None}
    if complaints := [*misfits(where, DECODERS[medium], chosen)]:
        raise UserError("; ".join(complaints) + ".")


def _are_channels(channels: Sequence[Any]) -> bool:
    kept = {
        each
        for each in channels
        if (type(each) is int and 0 <= each < MAX_AXES) or (isinstance(each, str) and each)
    }
    return not isinstance(channels, str) and 0 < len(kept) == len(channels)


MAX_KEPT = 1 << 28  # bytes of samples; a file beyond them is read again

T = TypeVar("T", bound=tuple[Any, ...])

_kept: dict[tuple[object, ...], Any] = {}
_lock = Lock()  # files are read in threads
_keeps, _bytes = False, 0  # bytes that were kept since all was freed


@contextmanager
def keeping_traces() -> Iterator[None]:
    """Keep in memory what :func:`read_once` reads in this context."""
    global _keeps
    _keeps = True
    try:
        yield
    finally:
        _keeps = False


def forget_traces() -> None:
    """Free what is kept."""
    global _bytes
    with _lock:
        _kept.clear()
        _bytes = 0


def read_once(read: Callable[..., T], path: Path, *how: Any) -> T:  # noqa: ANN401
    """Return ``read(path, *how)``, or the result that an earlier call has kept, and free that.

    Args:
        read: Function that returns a tuple whose first item is the samples.
        path: File to read; it is read again if it has changed since.
        *how: Further arguments of the function.

    Raises:
        UserError: As ``read`` does.
    """
    stat = path.stat() if is_file(path) else None  # of any of the files of a trace
    key = (read, path, how, stat and (stat.st_mtime_ns, stat.st_size))
    global _bytes
    with _lock:
        kept: Any = _kept.get(key) if _keeps else _kept.pop(key, None)
    if kept is not None:
        return kept  # type: ignore[no-any-return]  # what read has returned
    result = read(path, *how)
    size = result[0].nbytes
    with _lock:
        if _keeps and key not in _kept and _bytes + size <= MAX_KEPT:
            _kept[key] = result
            _bytes += size
    return result
