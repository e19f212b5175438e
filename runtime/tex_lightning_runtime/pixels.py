"""Photos as arrays (height, width, 3) uint8: their shape, halved, and cut to a size."""

from typing import Any

import numpy as np

from tex_lightning_runtime.errors import UserError
from tex_lightning_runtime.photos import to_rgb
from tex_lightning_runtime.samples import Array, as_array

MAX_PIXELS, MAX_SIDE = 1 << 24, 1 << 12  # of a photo that is kept, after halving


def as_pixels(image: Any, key: str = "image", colour: str = "rgb") -> Array:
    """Convert an array or tensor to pixels (height, width, 3) uint8 RGB, a copy.

    Args:
        image: (height, width, 3) or, of greys, (height, width); uint8. An image of Pillow may have
            any mode.
        key: Name of the argument, for messages.
        colour: ``rgb``, or ``bgr`` as OpenCV gives them; an image of Pillow knows its own.

    Raises:
        UserError: If it has another shape or type, or is empty.
    """
    knows_colours = hasattr(image, "getexif")  # of Pillow
    array = to_rgb(image, keeps=True)[0] if knows_colours else as_array(image, key)
    if array.ndim == 2:
        array = np.repeat(array[..., None], 3, axis=2)
    if array.dtype != np.uint8 or array.ndim != 3 or array.shape[2] != 3 or not array.size:
        raise UserError(
            f"{key} is an array of {array.dtype} of the shape {array.shape}; give uint8 pixels "
            "(height, width, 3), colours last, or (height, width) in grey."
        )
    if colour not in ("rgb", "bgr"):
        raise UserError(f"colour is {colour!r}; choose rgb or bgr.")
    pixels = array[..., ::-1] if colour == "bgr" and not knows_colours else array
    return np.array(pixels, order="C")  # some are read-only


def middle(photo: Array, scale: int, name: str) -> Array:
    """Cut out the middle of a photo of more than MAX_PIXELS, which bounds memory and time.

    Args:
        photo: (height, width, 3).
        scale: By how much it is going to be reduced; the pixels are counted then.
        name: Name of the photo, for messages.

    Raises:
        UserError: If there is nothing to be reduced.
    """
    sizes = [length // scale for length in photo.shape[:2]]
    if not all(sizes):
        raise UserError(f"{name} is too thin to be halved; use a larger one.")
    if sizes[0] * sizes[1] <= MAX_PIXELS:
        return photo
    kept = [min(size, MAX_PIXELS // min(MAX_SIDE, *sizes)) for size in sizes]
    top, left = (scale * ((size - each) // 2) for size, each in zip(sizes, kept, strict=True))
    return photo[top : top + scale * kept[0], left : left + scale * kept[1]].copy()


def halve(photo: Array) -> Array:
    """Half-scale an RGB photo: each pixel is the rounded mean of a 2x2 block."""
    from PIL import Image  # where it is needed: start-up is counted in milliseconds

    height, width = photo.shape[0] // 2 * 2, photo.shape[1] // 2 * 2
    return np.array(Image.fromarray(photo[:height, :width]).reduce(2))
