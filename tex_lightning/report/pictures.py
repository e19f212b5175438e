"""Pictures of recordings and of network inputs as pixels, in rows with captions."""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import scipy
import torch
from matplotlib.font_manager import findfont
from matplotlib.ft2font import FT2Font
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from tex_lightning.report.style import STYLE, brief
from tex_lightning.senses.features.image import ImageFeatures
from tex_lightning.text import printable

Pixels = npt.NDArray[np.uint8]
OUTER = 0.5  # percent of the values at each end whose shade is that of the end
STRETCHED = 8  # times as long as wide, from which the sides of a picture are changed apart
MIN_SIDE = 96  # pixels on the shorter side, to which smaller inputs are enlarged
MAX_SIDE = 640  # pixels along a picture
LINE = 14  # pixels of a line of text
LETTERS = 10  # pixels of a letter's height
GAP = 6
WINDOW = 0.05  # s, of a spectrogram
FLOOR = 1e-6  # of the largest power, which a picture shows
MAX_CAPTION = 40  # characters
CAPTIONED = 320  # pixels that a caption may widen narrow pictures to


def input_pixels(x: Tensor, features: object, largest: int = MAX_SIDE) -> Pixels:
    """Return a network input (C, height, width) as a picture (h, w, 3), low bands at the bottom.

    A photo that was normalised for a trunk gets its colours back; anything else is shown in shades
    from its smallest to its largest values, axes and channels above each other.

    Args:
        x: The input of one recording; a signal's may have fewer or more dimensions, time last.
        features: The features that made it.
        largest: Pixels along the picture.
    """
    x = x.detach().float().cpu()
    if isinstance(features, ImageFeatures) and x.dim() == 3 and len(x) == 3:
        colours = (x * features.std.cpu() + features.mean.cpu()) * 255
        pixels = colours.round().clamp(0, 255).to(torch.uint8).permute(1, 2, 0).numpy()
        return _sized(pixels, largest)
    values = x.reshape(-1, x.shape[-1]).numpy()[::-1]
    return _sized(shaded(values), largest)


def shaded(values: npt.NDArray[np.float32]) -> Pixels:
    """Return values (height, width) as shades (height, width, 3), extremes cut off."""
    from matplotlib import colormaps  # slow, and what has no figures does without

    low, high = np.percentile(values, (OUTER, 100 - OUTER))
    levels = (values - low) / max(high - low, 1e-12)
    return np.asarray(colormaps["viridis"](levels.clip(0, 1), bytes=True)[..., :3])


def _sized(pixels: Pixels, largest: int) -> Pixels:
    """Enlarge a small picture by whole factors, and reduce a large one.

    Proportions are kept, but where one side is far longer, as that of some features in time is.
    """
    sides = np.array(pixels.shape[:2])
    factors, apart = np.maximum(1, MIN_SIDE // sides), sides.max() > STRETCHED * sides.min()
    enlarged = sides * (factors if apart else factors.max())
    shares = largest / (enlarged if apart else enlarged.max())
    height, width = np.maximum(1, enlarged * np.minimum(1, shares)).round().astype(int).tolist()
    smaller = min(width, sides[1]), min(height, sides[0])
    reduced = cv2.resize(pixels, smaller, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(reduced, (width, height), interpolation=cv2.INTER_NEAREST))


def recording_picture(
    recording: npt.NDArray[Any], rate: float | None, size: tuple[int, int]
) -> Pixels:
    """Return a small picture of a decoded recording.

    Args:
        recording: A signal (axes, samples), shown as its power in dB over time (to the right) and
            frequency (upwards), of all axes together; or a photo (height, width, 3), of which the
            middle is shown.
        rate: Rate of the signal in Hz; None of a photo.
        size: Width and height in pixels.
    """
    if rate is None:
        side = min(recording.shape[:2])
        top, left = ((length - side) // 2 for length in recording.shape[:2])
        picture = np.asarray(recording[top : top + side, left : left + side])
    else:
        signal = np.asarray(recording, np.float32)
        length = min(max(16, round(WINDOW * rate)), signal.shape[1])
        *_, power = scipy.signal.spectrogram(signal, rate, nperseg=length, noverlap=length // 2)
        power = power.sum(axis=0)
        levels = np.log10(np.maximum(power, max(power.max() * FLOOR, 1e-30)))
        picture = shaded(levels[::-1])
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))


def row_of(pictures: Sequence[Pixels], captions: Sequence[str], across: int = 4) -> Pixels:
    """Return pictures beside each other with captions below, in rows of at most ``across``."""
    width = max(picture.shape[1] for picture in pictures)
    height = max(picture.shape[0] for picture in pictures) + LINE
    columns = min(across, len(pictures))
    rows = -(-len(pictures) // columns)
    size = (columns * (width + GAP) - GAP, rows * (height + GAP) - GAP)
    sheet = Image.new("RGB", size, "white")
    draw = ImageDraw.Draw(sheet)
    for place, (picture, caption) in enumerate(zip(pictures, captions, strict=True)):
        x, y = place % columns * (width + GAP), place // columns * (height + GAP)
        sheet.paste(Image.fromarray(picture), (x, y))
        _write(draw, (x, y + picture.shape[0] + 1), brief(caption, MAX_CAPTION), width)
    return np.asarray(sheet)


def _write(draw: ImageDraw.ImageDraw, place: tuple[int, int], text: str, width: int) -> None:
    """Write as much of a text as fits a width in pixels."""
    font = _font(text)
    while len(text) > 1 and font.getlength(text) > width:
        text = f"{text[:-2]}…"
    draw.text(place, text, fill="black", font=font)


def _font(text: str) -> ImageFont.FreeTypeFont:
    """Return the first of the figures' fonts that has all signs of a text, or the first."""
    fonts = [_loaded(name) for name in STYLE["font.family"]]
    return next((font for font, signs in fonts if {*map(ord, text)} <= signs), fonts[0][0])


@cache
def _loaded(name: str) -> tuple[ImageFont.FreeTypeFont, set[int]]:
    """Return a font and its signs; Pillow's own has no umlauts."""
    file = findfont(name)
    return ImageFont.truetype(file, LETTERS), {*FT2Font(file).get_charmap()}


def captioned(rows: Sequence[tuple[str, Sequence[Pixels]]]) -> Pixels:
    """Return pictures below each other, in rows with a caption above each that has one."""
    sizes = []
    for caption, pictures in rows:
        length = _font(caption).getlength(printable(caption))
        width = min(CAPTIONED, math.ceil(length))
        width = max(width, sum(picture.shape[1] + GAP for picture in pictures) - GAP)
        height = max((picture.shape[0] for picture in pictures), default=0)
        sizes.append((width, height + (LINE if caption else 0) + 2))
    width = max(*(size[0] for size in sizes), MIN_SIDE)
    sheet = Image.new("RGB", (width, sum(size[1] for size in sizes)), "white")
    draw, y = ImageDraw.Draw(sheet), 0
    for (caption, pictures), (_, height) in zip(rows, sizes, strict=True):
        if caption:
            _write(draw, (0, y), printable(caption), width)
        x, top = 0, y + (LINE if caption else 0)
        for picture in pictures:
            sheet.paste(Image.fromarray(picture), (x, top))
            x += picture.shape[1] + GAP
        y += height
    return np.asarray(sheet)
