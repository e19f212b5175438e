"""Photos out of files, as RGB with 8 bits, also of slightly damaged files and of other modes.

How other pixels become 8 bits: greys of 16 bits count from black (0) to white (65535), or to 4095
where none is brighter, as cameras with 12 bits write them, or to 255, as arrays of integers hold
them; numbers with a point from 0 to 1, or to 255 where some are larger. Colours of 16 bits lose the
lower 8, and those of 12 all but 4. Colours beneath transparent pixels are taken as they are stored,
and the first page of several.
"""

import ctypes
import re
import struct
import warnings
import zlib
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from tex_lightning_runtime.errors import UserError, reason
from tex_lightning_runtime.files import require_file
from tex_lightning_runtime.samples import Array

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".jfif", ".png", ".bmp", ".tif", ".tiff", ".webp")
FORMATS = ("JPEG", "PNG", "BMP", "TIFF", "WEBP")  # whatever a name says; EPS starts a program
# Of a JPEG at its end: one row of its blocks, the one above with which colours are mixed; a tenth.
LOST_ROWS, LOST_SHARE = 17, 0.1
TWELVE_BITS, SIXTEEN_BITS = 4095, 65535
DEEP = re.compile(r"\b(RGB.?|LA|R);16")  # of Pillow's names for how pixels lie in a file
BITS = 258  # a tag of TIFF
WHITE_IS_ZERO = 262, 0  # a tag of TIFF and its value, which Pillow minds in greys of 8 bits alone
MAX_MENDED = 1 << 28  # bytes of a file
PNG, JPEG, END = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"\xff\xd9"
KEPT = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")  # chunks of a PNG that its pixels need
FILLS = (b"\x00", b"\x55")  # of what is missing: where the pixels differ by it, they are lost


def read_photo(path: Path) -> tuple[Array, list[str]]:
    """Read a photo (height, width, 3) uint8, upright, and what is to be said of it.

    Raises:
        UserError: If it is missing, empty, no image, or damaged so that more than a little is
            missing.
    """
    from PIL import UnidentifiedImageError  # where it is needed: start-up takes milliseconds

    require_file(path)
    suppress_libtiff()
    try:
        with warnings.catch_warnings(action="ignore"):  # of metadata
            return _read(path)
    except UnidentifiedImageError as error:
        raise UserError(
            f"Image {path} is in no known format, or in a rare kind of one, whatever its name; "
            "convert it to JPEG or PNG with 8 bits."
        ) from error
    except Exception as error:  # damage shows in as many ways as there are formats
        raise UserError(
            f"Image {path} is damaged or too large ({reason(error)}); replace the file."
        ) from error


@cache
def suppress_libtiff() -> None:
    """Suppress the output of the libtiff that comes with Pillow; another one may print."""
    from PIL import _imaging

    home = Path(_imaging.__file__).parents[1]
    for folder in ("pillow.libs", "PIL/.dylibs"):
        for library in (home / folder).glob("libtiff*"):
            ctypes.CDLL(str(library)).TIFFSetErrorHandler(None)


def _read(path: Path) -> tuple[Array, list[str]]:
    from PIL import Image

    try:
        # by a stream: Pillow maps pixels of a TIFF that is turned by its path in the wrong shape
        with path.open("rb") as stream, Image.open(stream, formats=FORMATS) as image:
            return to_rgb(image)
    except Exception:
        content = path.read_bytes() if path.stat().st_size <= MAX_MENDED else b""
        lost, note = 0, "its texts or its end are damaged and left out"
        if content.startswith(PNG):
            kept = (chunk for chunk in _chunks(content) if chunk[4:8] in KEPT)
            content = PNG + b"".join(kept)  # without what its pixels do not need
        elif content.startswith(JPEG):
            content, note = content.removesuffix(END[:1]) + END, "its end is missing"
            lost = _lost_rows(content)
        else:
            raise
    with Image.open(BytesIO(content), formats=FORMATS) as image:
        if lost:
            note += f", and its last {lost} of {image.height} rows are left out"
        photo, notes = to_rgb(image.crop((0, 0, image.width, image.height - lost)))
    return photo, [note, *notes]


def to_rgb(image: Any, *, keeps: bool = False) -> tuple[Array, list[str]]:
    """Return an image of Pillow as (height, width, 3) uint8, upright, and what is to be said of it.

    Args:
        image: As it was opened: a copy has lost how its pixels are meant.
        keeps: Whether it must not be turned upright itself.

    Raises:
        ValueError: If its pixels cannot be meant as a photo.
    """
    from PIL import ImageCms, ImageOps

    notes = _pages(image)
    _mend_planes(image)
    is_deep = any(DEEP.search(str(tile[3])) for tile in getattr(image, "tile", ()))
    tag, value = WHITE_IS_ZERO
    is_negative = getattr(image, "tag_v2", {}).get(tag) == value
    image.load()  # what is damaged here is the pixels
    image = image.copy() if keeps else image
    try:
        ImageOps.exif_transpose(image, in_place=True)
    except Exception:
        notes.append("its orientation is damaged and left out")
    if image.mode in ("PA", "La", "RGBa") or (
        "transparency" in image.info and image.mode in ("P", "L", "RGB")
    ):
        image = image.convert("RGBA")
    if image.mode in ("RGBA", "LA") and image.getchannel("A").getextrema()[0] < 255:
        notes.append("it is transparent in places, and the colours beneath count")
    if image.mode == "LAB":
        lab, rgb = ImageCms.createProfile("LAB"), ImageCms.createProfile("sRGB")
        image = ImageCms.profileToProfile(image, lab, rgb, outputMode="RGB")
    if image.mode[0] in "IF":
        grey, note = _grey(np.asarray(image))
        grey = 255 - grey if is_negative else grey
        return np.repeat(grey[..., None], 3, axis=2), [*notes, note]
    photo = np.array(image if image.mode == "RGB" else image.convert("RGB"))
    if is_deep and photo.max() <= TWELVE_BITS >> 8:
        photo *= 255 // (TWELVE_BITS >> 8)
        notes.append("its colours from 0 to 4,095 become 16 levels: save it with 8 bits for all")
    return photo, notes


def _mend_planes(image: Any) -> None:
    """Say to Pillow that planes of a TIFF have 16 bits, which it reads as if they had 8."""
    tags: Any = getattr(image, "tag_v2", {})
    if tags.get(BITS, (8,))[0] == 16 and image.tile and image.tile[0].args[0] == "R":
        deep = ";16B" if tags.prefix == b"MM" else ";16L"
        image.tile = [
            tile._replace(args=(tile.args[0] + deep, *tile.args[1:])) for tile in image.tile
        ]


def _pages(image: Any) -> list[str]:
    """Say that an image has several pages, where they are not what a phone adds to a photo."""
    with suppress(Exception):  # a later page may be damaged
        if image.format != "MPO" and getattr(image, "n_frames", 1) > 1:
            return ["it has several pages or frames, and the first is read"]
    return []


def _grey(values: Array) -> tuple[Array, str]:
    """Return greys (height, width) of more than 8 bits, or with a point, as uint8; see above."""
    low, high = float(values.min()), float(values.max())
    if not 0 <= low <= high <= SIXTEEN_BITS:  # false for NaN
        raise ValueError(
            f"its pixels are {low:g} to {high:g}, and greys are 0 to {SIXTEEN_BITS:,}: save it "
            "with 8 bits"
        )
    if high <= 255:
        white = 1.0 if values.dtype.kind == "f" and high <= 1 else 255.0
    else:
        white = TWELVE_BITS if high <= TWELVE_BITS else SIXTEEN_BITS
    note = f"its greys from 0 to {white:,.0f} become 8 bits"
    return np.rint(values.astype(np.float64) * (255 / white)).astype(np.uint8), note


def _chunks(content: bytes) -> Iterator[bytes]:
    """Yield the chunks of a PNG, each whole: length, name, data and check sum."""
    place = len(PNG)
    while place + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, place)
        yield (chunk := content[place : place + 12 + length])
        if chunk[4:8] in KEPT and zlib.crc32(chunk[4:-4]) != struct.unpack(">I", chunk[-4:])[0]:
            raise ValueError(
                f"its pixels are damaged (chunk {chunk[4:8].decode(errors='replace')})"
            )
        place += 12 + length


def _lost_rows(content: bytes) -> int:
    """Return how many rows at the end of a JPEG are missing, if it is only a little.

    The pixels are computed twice, with different data in place of what is missing. What is there
    does not depend on them.

    Raises:
        ValueError: If it is more.
    """
    from PIL import Image

    photos = []
    for fill in FILLS:
        filled = content.removesuffix(END) + 4096 * fill + END
        with Image.open(BytesIO(filled), formats=FORMATS) as image:
            photos.append(np.asarray(image.convert("RGB")))
    (differ,) = (photos[0] != photos[1]).any(axis=(1, 2)).nonzero()
    lost = len(photos[0]) - int(differ[0]) if len(differ) else 0
    if lost > min(LOST_ROWS, LOST_SHARE * len(photos[0])):
        raise ValueError(f"truncated: {lost} of {len(photos[0])} rows are missing")
    return lost
