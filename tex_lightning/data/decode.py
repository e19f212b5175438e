"""Decode one file to an array, strictly: damaged files are refused, never guessed.

A checkpoint carries the settings used here, so prediction decodes as training did.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
import scipy  # whose parts are loaded when they are used
import torch
from PIL import Image, ImageOps, UnidentifiedImageError
from torch.nn import functional

from tex_lightning.core.console import quietly, silence_libtiff
from tex_lightning.core.files import require_file
from tex_lightning.data.rates import SourceRate, source_rate
from tex_lightning.data.trace_files import MOST_SAMPLES, TRACE_SUFFIXES, read_axes
from tex_lightning.errors import UserError, reason

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
IMAGE_FORMATS = ("JPEG", "PNG", "BMP", "TIFF", "WEBP")  # whatever a name says; EPS starts a program
MAX_PIXELS, MAX_SIDE = 1 << 24, 1 << 12  # of a photo that is kept, after halving
STRIP = 256  # rows of a photo converted at once; even, for halving
LARGEST = 1e9  # no unit of acceleration comes near; squares still fit float32
Array = npt.NDArray[Any]
Trace = npt.NDArray[np.float32]
Photo = npt.NDArray[np.uint8]


class Decoder(ABC):
    """How the files of one sense become arrays; its fields decide their content.

    Attributes:
        suffixes: Suffixes of the files that it reads, in lower case.
        unit: Unit of :meth:`extent`.
        precision: How that is written.
    """

    suffixes: ClassVar[tuple[str, ...]]
    unit: ClassVar[str]
    precision: ClassVar[str]

    @abstractmethod
    def decode(self, path: Path, rate: float | None = None) -> tuple[Array, SourceRate | None]:
        """The array of a file, and at which rate it was sampled if it is a signal.

        Args:
            path: The file.
            rate: Rate in Hz, if the manifest or the reader knows it.

        Raises:
            UserError: If the file cannot be used.
        """

    def assuming(self, rate: float | None) -> Self:
        """The same for files at another rate in Hz than those of the training; None for theirs."""
        return self

    @abstractmethod
    def extent(self, array: Array) -> float:
        """How long or large a decoded recording is."""


@dataclass(frozen=True)
class SignalDecoder(Decoder):
    """Decoder of signals: traces and sounds, (axes, samples) float32.

    Attributes:
        sampling_rate: Rate in Hz that every signal is brought to.
        file_rate: Rate in Hz of signals whose file and reader give none.
        channel: Which channel of a sound, or column of a table beside its time, is read, counted
            from 0; None reads all, one or three.
    """

    sampling_rate: float = 10_000.0
    file_rate: float = 10_000.0
    channel: int | None = None

    suffixes: ClassVar[tuple[str, ...]] = TRACE_SUFFIXES
    unit: ClassVar[str] = "s"
    precision: ClassVar[str] = ".3g"

    def __post_init__(self) -> None:
        if self.channel is not None and (type(self.channel) is not int or self.channel < 0):
            raise UserError(
                f"model.SENSE.decode.channel is {self.channel!r}; give a number from 0, or null."
            )

    def decode(self, path: Path, rate: float | None = None) -> tuple[Trace, SourceRate]:
        """Read a trace of one or three axes and bring it to the configured rate.

        Args:
            path: A WAV file (any sample format), ``.npy`` array, or text/CSV with one sample a
                line; one of three files with an axis each stands for all
                (:func:`.trace_files.axis_files`).
            rate: Rate of this file in Hz if the manifest or the reader knows it; see :mod:`.rates`.

        Returns:
            float32 array of shape (axes, samples), axes 1 or 3, in the file's unit; its own rate.

        Raises:
            UserError: If the file is missing, empty, damaged, of another shape, or holds NaN, or if
                two places state different rates.
        """
        samples, source = read_trace(path, self, rate)
        said = f"Trace {path}" if source.source != "assumed" else f"Trace {path}, by assumption,"
        return to_rate(samples, source.hz, self.sampling_rate, said), source

    def assuming(self, rate: float | None) -> Self:
        """As the base class."""
        return self if rate is None else replace(self, file_rate=rate)

    def extent(self, array: Array) -> float:
        """Length in seconds."""
        return float(array.shape[1] / self.sampling_rate)


@dataclass(frozen=True)
class PhotoDecoder(Decoder):
    """Decoder of photos, (height, width, 3) uint8.

    Attributes:
        half_scale: Whether they are halved (the paper's preprocessing, section III-B).
        resize: Side in pixels of the square that they are brought to; None leaves their size.
    """

    half_scale: bool = True
    resize: int | None = None

    suffixes: ClassVar[tuple[str, ...]] = IMAGE_SUFFIXES
    unit: ClassVar[str] = "megapixels"
    precision: ClassVar[str] = ".2g"

    def decode(self, path: Path, rate: float | None = None) -> tuple[Photo, None]:
        """Decode a photo as :func:`decode_image` does."""
        return decode_image(path, self), None

    def extent(self, array: Array) -> float:
        """Size in megapixels."""
        return float(array.shape[0] * array.shape[1] / 1e6)


def read_trace(
    path: Path, settings: SignalDecoder, rate: float | None = None
) -> tuple[npt.NDArray[np.floating], SourceRate]:
    """Read a trace as it stands in its file: samples (axes, samples) and their rate.

    Arguments and errors are those of :meth:`SignalDecoder.decode`.
    """
    raw = read_axes(path, settings.channel)
    check_samples(raw.samples, f"Trace {path}")
    return raw.samples, source_rate(path, raw, rate, settings.file_rate)


def to_rate(trace: npt.NDArray[np.floating], source: float, target: float, name: str) -> Trace:
    """Bring samples (axes, samples) from the rate ``source`` to the rate ``target`` in Hz.

    Raises:
        UserError: If the rates are too far apart, beginning with ``name``.
    """
    ratio = rate_ratio(source, target, name)
    if (count := trace.size * ratio) > MOST_SAMPLES:
        raise UserError(
            f"{name} has a sampling rate of {source:g} Hz, so that it would become "
            f"{float(count):g} samples at {target:g} Hz; correct that rate, or divide the file."
        )
    if ratio != 1:
        trace = scipy.signal.resample_poly(trace, ratio.numerator, ratio.denominator, axis=1)
    return np.ascontiguousarray(trace, dtype=np.float32)


def rate_ratio(source: float, target: float, name: str) -> Fraction:
    """Ratio of the number of samples at ``target`` Hz to that at ``source`` Hz.

    Raises:
        UserError: If the rates are too far apart, beginning with ``name``.
    """
    near = 1e-4 < target / source < 1e4  # a fraction is made of no infinity
    ratio = Fraction(target / source).limit_denominator(10_000) if near else Fraction(0)
    if not 0.001 < ratio < 1000:
        raise UserError(
            f"{name} has a sampling rate of {source:g} Hz, too far from {target:g} Hz; correct "
            "that rate (data.file_rate where it is assumed) or data.sampling_rate."
        )
    return ratio


def decode_image(path: Path, settings: PhotoDecoder, *, fast: bool = False) -> Photo:
    """Read a photo as RGB, upright, halved or resized if so configured.

    Args:
        path: An image file.
        settings: Whether it is halved or resized.
        fast: Let the JPEG decoder do the halving: it leaves out the upper half of each block's
            frequencies, which takes half the time and is near the mean of 2x2 pixels, not equal
            to it. Other formats, and photos that are not halved, are decoded as ever.

    Returns:
        uint8 array of shape (height, width, 3).

    Raises:
        UserError: If the file is missing, empty, truncated, no image, or not 8 bits a channel.
    """
    require_file(path)
    silence_libtiff()
    try:
        with quietly(), Image.open(path, formats=IMAGE_FORMATS) as image:
            if image.mode.startswith(("I", "F")):
                raise UserError(f"Image {path} has {image.mode} pixels; save it with 8 bits.")
            halved = fast and settings.half_scale and _decodes_halved(image)
            photo = _pixels(image)
    except UnidentifiedImageError as error:
        raise UserError(f"Image {path} is in no known image format; use JPEG or PNG.") from error
    except Image.DecompressionBombError as error:
        raise UserError(f"Image {path} is too large ({reason(error)}); scale it down.") from error
    except UserError:
        raise
    except Exception as error:  # damage shows in as many ways as there are formats
        raise UserError(f"Image {path} is damaged ({reason(error)}); replace the file.") from error
    if halved and settings.resize is None:
        return _middle(photo)
    return to_size(photo, settings, f"Image {path}")


def to_size(photo: Photo, settings: PhotoDecoder, name: str) -> Photo:
    """Halve or resize a photo (height, width, 3) as the settings say.

    Of one that is not resized the middle is kept if it has more than 16.8 megapixels then.

    Raises:
        UserError: If there is too little to be halved, beginning with ``name``.
    """
    if settings.resize is not None:
        return _resized(photo, settings.resize)
    if not settings.half_scale:
        return _middle(photo)
    if min(photo.shape[:2]) < 2:
        raise UserError(f"{name} is too thin to be halved; set data.half_scale=false.")
    return _middle(halve(photo))


def _middle(photo: Photo) -> Photo:
    """Cut out the middle of a photo of more than MAX_PIXELS, which bounds memory and time."""
    sizes = photo.shape[:2]
    if sizes[0] * sizes[1] <= MAX_PIXELS:
        return photo
    kept = [min(size, MAX_PIXELS // min(MAX_SIDE, *sizes)) for size in sizes]
    top, left = ((size - each) // 2 for size, each in zip(sizes, kept, strict=True))
    return photo[top : top + kept[0], left : left + kept[1]].copy()


def _decodes_halved(image: Image.Image) -> bool:
    """Ask the decoder for half the size before it starts; only JPEG's can."""
    width, height = image.size
    if min(width, height) >= 2:
        image.draft(None, (width // 2, height // 2))
    return image.size != (width, height)


def _pixels(image: Image.Image) -> Photo:
    """Upright RGB pixels, copied once and strip by strip: a large photo has no room for more."""
    ImageOps.exif_transpose(image, in_place=True)
    upright = image if image.mode == "RGB" else image.convert("RGB")
    upright.load()
    photo = np.empty((upright.height, upright.width, 3), np.uint8)
    for top in range(0, upright.height, STRIP):
        bottom = min(top + STRIP, upright.height)
        photo[top:bottom] = np.asarray(upright.crop((0, top, upright.width, bottom)))
    return photo


def _resized(photo: Photo, side: int) -> Photo:
    """Bring a photo to ``side`` x ``side`` pixels, whatever its proportions; bilinear."""
    image = Image.fromarray(photo).resize((side, side), Image.Resampling.BILINEAR)
    return np.asarray(image).copy()


def halve(photo: Photo) -> Photo:
    """Half-scale an RGB photo: each pixel is the rounded mean of a 2x2 block.

    Bilinear interpolation to half the size is exactly that mean on even sizes. It is done in
    strips, because its pixels are float32.
    """
    height, width = photo.shape[0] // 2 * 2, photo.shape[1] // 2 * 2
    half = np.empty((height // 2, width // 2, 3), np.uint8)
    for top in range(0, height, STRIP):
        strip = torch.from_numpy(photo[top : min(top + STRIP, height), :width])
        pixels = strip.permute(2, 0, 1)[None].float()
        small = functional.interpolate(pixels, scale_factor=0.5, mode="bilinear")
        half[top // 2 : top // 2 + small.shape[2]] = small[0].add_(0.5).byte().permute(1, 2, 0)
    return half


def check_samples(trace: npt.NDArray[np.floating], name: str) -> None:
    """Refuse a trace (axes, samples) with a number that no sensor gives.

    Raises:
        UserError: Beginning with ``name``.
    """
    usable = usable_samples(trace)
    if not usable.all():
        raise UserError(
            f"{name} holds NaN, infinity or a number beyond {LARGEST:g} at sample "
            f"{usable.argmin()}; repair the recording."
        )


def usable_samples(trace: npt.NDArray[np.floating]) -> npt.NDArray[np.bool_]:
    """Which samples of a trace (axes, samples) are numbers that a sensor may give."""
    usable: npt.NDArray[np.bool_] = (np.abs(trace) < LARGEST).all(axis=0)  # false for NaN
    return usable


Samples = npt.NDArray[np.floating]
REACH = 10  # samples of the lower rate that the filter sees on each side, as scipy has it
KAISER = ("kaiser", 5.0)


class Resampler:
    """Resample chunk by chunk with a polyphase filter, keeping the samples that it still needs.

    Args:
        source: Rate in Hz of the samples that come.
        target: Rate in Hz to bring them to.
        name: What they are called in messages.

    Raises:
        UserError: If the rates are too far apart.
    """

    def __init__(self, source: float, target: float, name: str) -> None:
        ratio = rate_ratio(source, target, name)
        self.up, self.down = ratio.numerator, ratio.denominator
        widest = max(self.up, self.down)
        self.half = REACH * widest  # of the filter, in samples of the common multiple of the rates
        self.filter = scipy.signal.firwin(2 * self.half + 1, 1 / widest, window=KAISER)
        self.kept: Samples | None = None  # (axes, samples), begins at a multiple of `down`
        self.begin = 0  # of what is kept, in samples that came
        self.given = 0  # samples that were given back

    def push(self, samples: Samples) -> Trace:
        """Take samples (axes, samples); return those at the new rate that no later one changes.

        They lag by ten samples of the lower rate.
        """
        kept = samples if self.kept is None else np.concatenate((self.kept, samples), axis=1)
        came = self.begin + kept.shape[1]
        known = max(self.given, math.ceil((came * self.up - self.half) / self.down))
        found = self._between(kept, known)
        first = max(0, (known * self.down - self.half) // self.up)  # that later ones need
        begin = first // self.down * self.down
        self.kept, self.begin = kept[:, begin - self.begin :].copy(), begin
        return found

    def finish(self) -> Trace | None:
        """Return the last samples, as if silence followed; None if there are none."""
        if self.kept is None:
            return None
        end = math.ceil((self.begin + self.kept.shape[1]) * self.up / self.down)
        return self._between(self.kept, end) if end > self.given else None

    def _between(self, kept: Samples, end: int) -> Trace:
        """Samples of the new rate from those given back before up to ``end``."""
        offset = self.begin // self.down * self.up
        found = np.empty((len(kept), 0))
        if end > self.given:
            found = scipy.signal.resample_poly(kept, self.up, self.down, axis=1, window=self.filter)
            found = found[:, self.given - offset : end - offset]
        self.given = end
        return np.ascontiguousarray(found, dtype=np.float32)
