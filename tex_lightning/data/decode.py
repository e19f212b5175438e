"""Decode one recording to an array, strictly: damaged files raise an error.

A checkpoint carries the settings used here, so prediction decodes as training did. Recordings given
as arrays are brought to the same form.
"""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
import numpy.typing as npt
import scipy  # whose parts are loaded when they are used
from PIL import Image, UnidentifiedImageError
from torch import Tensor

from tex_lightning.config.signatures import misfits
from tex_lightning.core.console import suppress_libtiff, suppress_warnings, warn_once
from tex_lightning.core.files import require_file
from tex_lightning.data.kept import read_once
from tex_lightning.data.traces import (
    MAX_AXES,
    MAX_SAMPLES,
    TRACE_SUFFIXES,
    axes_first,
    choose_channels,
    read_samples,
)
from tex_lightning.errors import UserError, reason
from tex_lightning_runtime.columns import Channels, Reading
from tex_lightning_runtime.photos import read_photo, to_rgb
from tex_lightning_runtime.times import UNITS

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
IMAGE_FORMATS = ("JPEG", "PNG", "BMP", "TIFF", "WEBP")  # whatever a name says; EPS starts a program
MAX_PIXELS, MAX_SIDE = 1 << 24, 1 << 12  # of a photo that is kept, after halving
LARGEST = 1e9  # no unit of acceleration comes near; squares still fit float32
SAME_RATE = 0.005  # by which clocks of the same rate may differ; such samples stay as they are
RATE_TOLERANCE = 0.01  # by which a rate that is stated may differ from that of a column of time
ASSUMED = "an assumption"
MIN_RATE, MAX_RATE = 19.0, 210_000.0  # Hz: 20 Hz to 200 kHz, by clocks that are not exact
RATES = f"[{MIN_RATE:g}, {MAX_RATE:g}]"
log = logging.getLogger(__name__)
Array = npt.NDArray[Any]
Trace = npt.NDArray[np.float32]
Photo = npt.NDArray[np.uint8]


class Decoded(NamedTuple):
    """Samples or pixels of a file, the rate of its samples in Hz, and how it was read."""

    array: Array
    rate: float | None = None
    reading: Reading | None = None  # of signals


@dataclass(frozen=True)
class SignalDecoder:
    """Decoder of signals: traces and sounds, (axes, samples) float32.

    Attributes:
        sampling_rate: Rate in Hz that every signal is brought to.
        file_rate: Rate in Hz of signals whose file and reader give none.
        channels: Channels of a sound, or columns of a table beside its time, that are kept: names,
            or numbers counted from 0; None keeps all.
        time_unit: Unit of times in tables that do not say it, such as ``ms``.
        assumes: Whether nobody has given ``file_rate``.
    """

    sampling_rate: Annotated[float, RATES] = 10_000.0
    file_rate: Annotated[float, RATES] = 10_000.0
    channels: tuple[int | str, ...] | None = None
    time_unit: str | None = None
    assumes: bool = False

    suffixes: ClassVar[tuple[str, ...]] = TRACE_SUFFIXES
    unit: ClassVar[str] = "s"
    precision: ClassVar[str] = ".3g"

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

    def decode(self, path: Path, rate: float | None = None) -> tuple[Trace, float]:
        """Read a trace and bring it to the configured rate.

        Args:
            path: A file as :func:`.traces.read_samples` reads it.
            rate: Rate of this file in Hz if the manifest or the reader knows it.

        Returns:
            float32 array of shape (axes, samples), in the file's unit and with its level; its own
            rate in Hz.

        Raises:
            UserError: If the file is missing, empty, damaged, of another shape, or holds NaN, or if
                it states another rate.
        """
        array, source, _ = self.read(path, rate)
        assert source is not None
        return array, source

    def read(self, path: Path, rate: float | None = None) -> Decoded:
        """Decode a trace, and return how its file was read, too; see :meth:`decode`."""
        samples, source, reading = read_trace(path, self, rate)
        trace = to_rate(samples, source, self.sampling_rate, f"Trace {path}")
        return Decoded(trace, source, reading)

    def assuming(
        self,
        rate: float | None,
        channels: Channels = None,
        time_unit: str | None = None,
    ) -> Self:
        """Return the decoder for files of another rate in Hz or other columns than in training.

        None leaves what it was.
        """
        given = self if rate is None else replace(self, file_rate=rate, assumes=False)
        if channels is not None:
            given = replace(given, channels=tuple(channels))
        return given if time_unit is None else replace(given, time_unit=time_unit)

    def extent(self, array: Array) -> float:
        """Return the length of a signal in :attr:`unit`."""
        return float(array.shape[1] / self.sampling_rate)


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
    precision: ClassVar[str] = ".2g"

    def decode(self, path: Path, rate: float | None = None) -> tuple[Photo, None]:
        """Read a photo as RGB, upright, halved or resized if so configured.

        Args:
            path: An image file.
            rate: Ignored for a photo.

        Returns:
            uint8 array of shape (height, width, 3); no rate.

        Raises:
            UserError: If the file is missing, empty, truncated by more than a little, or no image.
        """
        require_file(path)
        suppress_libtiff()
        try:
            with suppress_warnings():
                photo, notes = read_photo(path, IMAGE_FORMATS)
        except UnidentifiedImageError as error:
            raise UserError(f"Image {path} is in no known format; use JPEG or PNG.") from error
        except Exception as error:  # damage shows in as many ways as there are formats
            raise UserError(
                f"Image {path} is damaged or too large ({reason(error)}); replace the file."
            ) from error
        for note in notes:
            warn_once(log, f"Image {path}: {note} (said of the first such image).", note)
        return self.scale(photo, f"Image {path}"), None

    def read(self, path: Path, rate: float | None = None) -> Decoded:
        """Decode a photo; see :meth:`decode`."""
        return Decoded(self.decode(path)[0])

    def scale(self, photo: Photo, name: str) -> Photo:
        """Halve or resize a photo (height, width, 3).

        Of one that is not resized the middle is kept if it has more than 16.8 megapixels then.

        Raises:
            UserError: If there is too little to be halved, beginning with ``name``.
        """
        if self.resize is not None:
            square = self.resize, self.resize
            return np.array(Image.fromarray(photo).resize(square, Image.Resampling.BILINEAR))
        if self.half_scale:
            if min(photo.shape[:2]) < 2:
                raise UserError(f"{name} is too thin to be halved; set data.half_scale=false.")
            photo = halve(photo)
        return _middle(photo)

    def assuming(
        self, rate: float | None, channels: Channels = None, time_unit: str | None = None
    ) -> Self:
        """Return the decoder itself; photos have neither rate nor columns."""
        return self

    def extent(self, array: Array) -> float:
        """Return the size of a photo in :attr:`unit`."""
        return float(array.shape[0] * array.shape[1] / 1e6)


Decoder = SignalDecoder | PhotoDecoder  # its fields decide the content of the arrays
DECODERS: dict[str, type[Decoder]] = {"signal": SignalDecoder, "photo": PhotoDecoder}


def check_decoding(where: str, medium: str, settings: Mapping[str, Any]) -> None:
    """Reject settings that the decoder of a medium does not take, before anything is decoded.

    Args:
        where: Key of the settings.
        medium: ``signal`` or ``photo``.
        settings: Fields of the decoder; what is null is left to it.

    Raises:
        UserError: Naming all of them.
    """
    given = {name: value for name, value in settings.items() if value is not None}
    if complaints := [*misfits(where, DECODERS[medium], given)]:
        raise UserError("; ".join(complaints) + ".")


def _are_channels(channels: Sequence[Any]) -> bool:
    kept = {
        each
        for each in channels
        if (type(each) is int and 0 <= each < MAX_AXES) or (isinstance(each, str) and each)
    }
    return not isinstance(channels, str) and 0 < len(kept) == len(channels)


class SourceSignal(NamedTuple):
    """Samples (axes, samples) of a file, their rate in Hz, and how the file was read."""

    samples: npt.NDArray[np.floating]
    rate: float
    reading: Reading


def read_trace(path: Path, settings: SignalDecoder, rate: float | None = None) -> SourceSignal:
    """Read a trace as it stands in its file.

    The rate is the file's own, else the stated one, else the assumed ``data.file_rate``. Arguments
    and errors are those of :meth:`SignalDecoder.decode`.
    """
    samples, source, reading = read_once(read_samples, path, settings.channels, settings.time_unit)
    check_samples(samples, f"Trace {path}")
    if source is None and rate is not None:
        return SourceSignal(samples, rate, replace(reading, rate_from="the manifest or reader"))
    if source is None:
        said = f"{ASSUMED} (data.file_rate=HZ gives it)" if settings.assumes else "data.file_rate"
        return SourceSignal(samples, settings.file_rate, replace(reading, rate_from=said))
    if rate is not None and not math.isclose(source, rate, rel_tol=RATE_TOLERANCE):
        raise UserError(
            f"Trace {path} has {source:,.6g} Hz by its header or column of time, but {rate:,.6g} "
            "Hz by the manifest or reader; correct or remove one of them."
        )
    return SourceSignal(samples, source, reading)


def to_rate(trace: npt.NDArray[np.floating], source: float, target: float, name: str) -> Trace:
    """Resample (axes, samples) from the rate ``source`` to the rate ``target`` in Hz.

    Raises:
        UserError: If the rates are too far apart, beginning with ``name``.
    """
    ratio = rate_ratio(source, target, name)
    if (count := trace.size * ratio) > MAX_SAMPLES:
        raise UserError(
            f"{name} has a sampling rate of {source:g} Hz, so that it would become "
            f"{float(count):g} samples at {target:g} Hz; correct that rate, or divide the file."
        )
    if ratio != 1:
        trace = scipy.signal.resample_poly(trace, ratio.numerator, ratio.denominator, axis=1)
    return np.ascontiguousarray(trace, dtype=np.float32)


def rate_ratio(source: float, target: float, name: str) -> Fraction:
    """Return the ratio of the number of samples at ``target`` Hz to that at ``source`` Hz.

    It is 1 for rates that differ by less than half a percent, as those that a sensor's clock gives
    from one recording to the next.

    Raises:
        UserError: If ``source`` is no rate of a signal, beginning with ``name``.
    """
    if not MIN_RATE <= source <= MAX_RATE:
        raise UserError(
            f"{name} has a sampling rate of {source:g} Hz, too far from {target:g} Hz: rates are "
            "20 Hz to 200 kHz; correct it (data.file_rate where it is assumed; a column of time "
            "that is not in seconds is called time_ms, or has its data.time_unit)."
        )
    same = math.isclose(source, target, rel_tol=SAME_RATE)
    return Fraction(1 if same else target / source).limit_denominator(10_000)


def halve(photo: Photo) -> Photo:
    """Half-scale an RGB photo: each pixel is the rounded mean of a 2x2 block."""
    height, width = photo.shape[0] // 2 * 2, photo.shape[1] // 2 * 2
    return np.array(Image.fromarray(photo[:height, :width]).reduce(2))


def _middle(photo: Photo) -> Photo:
    """Cut out the middle of a photo of more than MAX_PIXELS, which bounds memory and time."""
    sizes = photo.shape[:2]
    if sizes[0] * sizes[1] <= MAX_PIXELS:
        return photo
    kept = [min(size, MAX_PIXELS // min(MAX_SIDE, *sizes)) for size in sizes]
    top, left = ((size - side) // 2 for size, side in zip(sizes, kept, strict=True))
    return photo[top : top + kept[0], left : left + kept[1]].copy()


def check_samples(trace: npt.NDArray[np.floating], name: str, place: int = 0) -> None:
    """Reject a trace (axes, samples) with NaN, infinite or absurdly large values.

    Args:
        trace: The samples, from number ``place`` of a longer recording on.
        name: Name of the samples in messages.
        place: Number of samples before them.

    Raises:
        UserError: Beginning with ``name``.
    """
    usable = (np.abs(trace) < LARGEST).all(axis=0)  # false for NaN
    if not usable.all():
        raise UserError(
            f"{name} holds NaN, infinity or a number beyond {LARGEST:g} at sample "
            f"{place + usable.argmin()}; repair the recording."
        )


def as_trace(
    samples: Any,  # noqa: ANN401  (what NumPy can read)
    key: str = "haptic",
    channels: Channels = None,
    *,
    is_chunk: bool = False,
) -> npt.NDArray[np.floating]:
    """Convert an array, tensor or list to samples (axes, samples), float64.

    Args:
        samples: (samples,), (axes, samples) or (samples, axes) with 1 to 64 axes, the longer
            dimension being time; integers or floating-point numbers, in the unit of the training
            recordings.
        key: Name of the argument, for messages.
        channels: Which of the axes are kept; None keeps all.
        is_chunk: Whether they are a piece of a stream, (samples,) or (axes, samples) of any length.

    Raises:
        UserError: If it has another shape or type, is empty, or holds NaN or infinity.
    """
    array = _as_array(samples, key)
    if array.dtype.kind not in "fiu":
        raise UserError(f"{key} is an array of {array.dtype}; give numbers.")
    trace = axes_first(array)
    if trace is not None and is_chunk:
        trace = array if array.ndim == 2 else array[None]
    if trace is None or len(trace) > MAX_AXES:
        raise UserError(
            f"{key} has the shape {array.shape}; give (axes, samples) with 1 to {MAX_AXES} axes, "
            "or (samples,), and at least one sample."
        )
    trace = choose_channels(trace.astype(np.float64), channels, key)
    check_samples(trace, key)
    return trace


def as_photo(image: Any, settings: PhotoDecoder, colour: str, key: str = "image") -> Photo:  # noqa: ANN401
    """Convert an array or tensor to pixels (height, width, 3) uint8 RGB, halved if configured.

    Args:
        image: (height, width, 3) or, of greys, (height, width); uint8. An image of Pillow may have
            any mode.
        settings: Settings of the checkpoint.
        colour: ``rgb``, or ``bgr`` as OpenCV gives them.
        key: Name of the argument, for messages.

    Raises:
        UserError: If it has another shape or type, or is empty.
    """
    array = to_rgb(image.copy())[0] if isinstance(image, Image.Image) else _as_array(image, key)
    if array.ndim == 2:
        array = np.repeat(array[..., None], 3, axis=2)
    if array.dtype != np.uint8 or array.ndim != 3 or array.shape[2] != 3 or not array.size:
        raise UserError(
            f"{key} is an array of {array.dtype} of the shape {array.shape}; give uint8 pixels "
            "(height, width, 3), colours last, or (height, width) in grey."
        )
    if colour not in ("rgb", "bgr"):
        raise UserError(f"colour is {colour!r}; choose rgb or bgr.")
    pixels = array[..., ::-1] if colour == "bgr" else array
    return settings.scale(np.array(pixels, order="C"), key)  # copied: some are read-only


def _as_array(values: Any, key: str) -> npt.NDArray[Any]:  # noqa: ANN401
    if isinstance(values, Tensor):
        tensor = values.detach().cpu()
        return (tensor.double() if tensor.is_floating_point() else tensor).numpy()  # no bfloat16
    try:
        return np.asarray(values)
    except ValueError as error:  # lists of unequal lengths
        raise UserError(f"{key} cannot be read as an array ({error}); give one.") from error
