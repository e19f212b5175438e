"""Samples of signals as arrays (axes, samples): their shape, and what they may hold."""

import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from tex_lightning_runtime.errors import UserError, reason

Array = np.ndarray[Any, np.dtype[Any]]
Channels = Sequence[int | str] | None  # numbers from 0, names of columns, or all
MAX_AXES = 64
MAX_SAMPLES = 1 << 29  # of a signal, 2 GiB of float32: 14 h of one axis at 10 kHz
MAX_VALUE = 1e9  # no unit of acceleration comes near; squares still fit float32


def as_trace(
    samples: Any, key: str = "haptic", channels: Channels = None, *, is_chunk: bool = False
) -> Array:
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
    array = as_array(samples, key)
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


def as_array(values: Any, key: str) -> Array:
    """Convert what NumPy can read, or a tensor of PyTorch on any device, to an array.

    Raises:
        UserError: If it is neither, beginning with ``key``.
    """
    try:
        return np.asarray(readable(values, key))
    except ValueError as error:  # lists of unequal lengths
        raise _unreadable(key, error) from error


def readable(values: Any, key: str) -> Any:
    """Return tensors and arrays with a mask as NumPy reads them; what is masked is NaN.

    Raises:
        UserError: If a tensor is sparse, nested or without values, beginning with ``key``.
    """
    if not hasattr(values, "is_floating_point"):  # PyTorch is not imported here
        return values.astype(float).filled(np.nan) if np.ma.is_masked(values) else values
    try:
        tensor = values.detach().cpu()
        return (tensor.double() if tensor.is_floating_point() else tensor).numpy()  # no bfloat16
    except (TypeError, RuntimeError) as error:
        raise _unreadable(key, error) from error


def _unreadable(key: str, error: Exception) -> UserError:
    return UserError(f"{key} cannot be read as an array ({reason(error)}); give one.")


def axes_first(samples: Array) -> Array | None:
    """Transpose (samples,), (axes, samples) or (samples, axes) to (axes, samples), 1 to 64 axes.

    Returns:
        None if the samples have another shape or there are none.
    """
    trace = samples[None] if samples.ndim == 1 else samples
    if trace.ndim != 2 or not trace.size or min(trace.shape) > MAX_AXES:
        return None
    return trace if trace.shape[0] <= trace.shape[1] else trace.T


def choose_channels(trace: Array, channels: Channels, name: str) -> Array:
    """Select the numbered axes of samples (axes, samples), counted from 0; None keeps all.

    Samples without names are those of the names that are asked for if there are as many.

    Raises:
        UserError: If there are not so many, beginning with ``name``.
    """
    if channels is None:
        return trace
    numbers = [each for each in channels if isinstance(each, int)]
    if len(numbers) < len(channels):
        if len(channels) != len(trace):
            raise UserError(
                f"{name} has {len(trace)} channels without names, and data.channels names "
                f"{', '.join(map(str, channels))}; give just these, or numbers, from 0."
            )
        return trace
    if (last := max(numbers)) >= len(trace):
        raise UserError(
            f"{name} has {len(trace)} channels, and data.channels names {last}, counted from 0; "
            "choose others."
        )
    return trace[numbers]


def check_samples(trace: Array, name: str, place: int = 0) -> None:
    """Reject a trace (axes, samples) with NaN, infinite or absurdly large values.

    Args:
        trace: The samples, from number ``place`` of a longer recording on.
        name: Name of the samples in messages.
        place: Number of samples before them.

    Raises:
        UserError: Beginning with ``name``.
    """
    usable = (np.abs(trace) < MAX_VALUE).all(axis=0)  # false for NaN
    if not usable.all():
        raise UserError(
            f"{name} holds NaN, infinity or a number beyond {MAX_VALUE:g} at sample "
            f"{place + usable.argmin()}; repair the recording."
        )


def content_seed(seed: int, *recordings: Array) -> int:
    """Return a seed from the content of a sample: its place in a batch or list cannot matter."""
    seed &= 0xFFFFFFFF
    for array in recordings:
        seed = zlib.crc32(np.ascontiguousarray(array).data, seed)
    return seed
