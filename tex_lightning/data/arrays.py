"""Traces and photos given as arrays, converted to the form of decoded files."""

from typing import Any

import numpy as np
import numpy.typing as npt
from torch import Tensor

from tex_lightning.data.decode import Photo, PhotoDecoder, check_samples, to_size
from tex_lightning.data.trace_files import axes_first
from tex_lightning.errors import UserError

COLOURS = ("rgb", "bgr")


def as_trace(given: Any, key: str = "haptic") -> npt.NDArray[np.floating]:  # noqa: ANN401  (what NumPy can read)
    """Convert an array, tensor or list to samples (axes, samples), float64.

    Args:
        given: (samples,), (axes, samples) or (samples, axes) with one or three axes; integers or
            floating-point numbers, in the unit of the training recordings.
        key: What they were given as.

    Raises:
        UserError: If it has another shape or type, is empty, or holds NaN or infinity.
    """
    array = _as_array(given, key)
    if array.dtype.kind not in "fiu":
        raise UserError(f"{key} is an array of {array.dtype}; give numbers.")
    trace = axes_first(array.astype(np.float64))
    if trace is None or not trace.size:
        raise UserError(
            f"{key} has the shape {array.shape}; give (samples,), (axes, samples) or (samples, "
            "axes) with one or three axes and at least one sample."
        )
    check_samples(trace, key)
    return trace


def as_photo(
    given: Any,  # noqa: ANN401
    settings: PhotoDecoder,
    colour: str,
    key: str = "image",
) -> Photo:
    """Convert an array or tensor to pixels (height, width, 3) uint8 RGB, halved if configured.

    Args:
        given: (height, width, 3) or, of greys, (height, width); uint8.
        settings: Settings of the checkpoint.
        colour: ``rgb``, or ``bgr`` as OpenCV gives them.
        key: What they were given as.

    Raises:
        UserError: If it has another shape or type, or is empty.
    """
    array = _as_array(given, key)
    if array.dtype != np.uint8:
        raise UserError(f"{key} is an array of {array.dtype}; give uint8 pixels from 0 to 255.")
    if array.ndim == 2:
        array = np.repeat(array[..., None], 3, axis=2)
    if array.ndim != 3 or array.shape[2] != 3 or not array.size:
        raise UserError(
            f"{key} has the shape {array.shape}; give (height, width, 3), colours last, or "
            "(height, width) in grey."
        )
    if colour not in COLOURS:
        raise UserError(f"colour is {colour!r}; choose {' or '.join(COLOURS)}.")
    pixels = array[..., ::-1] if colour == "bgr" else array
    return to_size(np.array(pixels, order="C"), settings, key)  # copied: some are read-only


def _as_array(given: Any, key: str) -> npt.NDArray[Any]:  # noqa: ANN401
    if isinstance(given, Tensor):
        tensor = given.detach().cpu()
        if tensor.is_floating_point():
            tensor = tensor.double()  # NumPy has no bfloat16
        return tensor.numpy()
    try:
        return np.asarray(given)
    except ValueError as error:  # lists of unequal lengths
        raise UserError(f"{key} cannot be read as an array ({error}); give one.") from error
