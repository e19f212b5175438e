"""Published files of weights: ``.caffemodel``, MatConvNet's ``.mat``, EfficientNet-Lite's ``.pth``.

A ``.caffemodel`` is read from protobuf's wire format without Caffe or a schema. Field numbers are
those of ``caffe.proto``: a network holds ``layer`` (100) or, in files of 2014, ``layers`` (2); a
layer has a name and blobs; a blob has a shape and numbers. Everything else is passed over.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy  # whose parts are loaded when they are used
import torch
from torch import Tensor

VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
NAME_AND_BLOBS = {2: (4, 6), 100: (1, 7)}  # fields of a layer by the field of the network
OLD_SHAPE = (1, 2, 3, 4)  # num, channels, height, width
FLOATS, DOUBLES, SHAPE = 5, 8, 7
DTYPES = {FLOATS: "<f4", DOUBLES: "<f8"}
Array = npt.NDArray[np.floating]


def read_caffemodel(path: Path) -> dict[str, Array]:
    """Read the first two blobs of every layer as ``{layer}.weight`` and ``{layer}.bias``.

    Raises:
        ValueError: If the file is cut off or no such file.
    """
    arrays: dict[str, Array] = {}
    for number, content in _fields(memoryview(path.read_bytes())):
        if number not in NAME_AND_BLOBS or not isinstance(content, memoryview):
            continue
        name_field, blob_field = NAME_AND_BLOBS[number]
        name, blobs = "", []
        for field, value in _fields(content):
            if field == name_field and isinstance(value, memoryview):
                name = bytes(value).decode()
            elif field == blob_field and isinstance(value, memoryview):
                blobs.append(_blob(value))
        for kind, blob in zip(("weight", "bias"), blobs, strict=False):
            arrays[f"{name}.{kind}"] = blob
    if not arrays:
        raise ValueError("no layers")
    return arrays


def _blob(content: memoryview) -> Array:
    """An array; a bias that the old form calls 1 x 1 x 1 x n has n elements."""
    shape: list[int] = []
    old = dict.fromkeys(OLD_SHAPE, 0)
    parts: list[Array] = []
    for number, value in _fields(content):
        if number == SHAPE and isinstance(value, memoryview):
            shape = [size for _, packed in _fields(value) for size in _varints(packed)]
        elif number in old and isinstance(value, int):
            old[number] = value
        elif number in DTYPES and isinstance(value, memoryview):
            parts.append(np.frombuffer(value, DTYPES[number]))
    if any(old.values()):
        shape = list(old.values())
        if shape[:3] == [1, 1, 1]:
            shape = shape[3:]
    return np.concatenate(parts or [np.empty(0, "<f4")]).reshape(shape)


def _fields(content: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Number and content of every field of a message: an integer, or bytes."""
    place = 0
    while place < len(content):
        tag, place = _varint(content, place)
        number, kind = tag >> 3, tag & 7
        if kind == VARINT:
            value, place = _varint(content, place)
            yield number, value
            continue
        if kind == BYTES:
            size, place = _varint(content, place)
        elif kind in (FIXED32, FIXED64):
            size = 4 if kind == FIXED32 else 8
        else:
            raise ValueError(f"unknown wire type {kind}")
        if number == 0 or place + size > len(content):
            raise ValueError("cut off")
        yield number, content[place : place + size]
        place += size


def _varint(content: memoryview, place: int) -> tuple[int, int]:
    """The integer that begins at ``place``, seven bits a byte, and the place behind it."""
    value = 0
    for shift in range(0, 70, 7):
        if place >= len(content):
            break
        byte = content[place]
        place += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, place
    raise ValueError("cut off")


def _varints(packed: int | memoryview) -> Iterator[int]:
    """Integers of a repeated field, packed or single."""
    if isinstance(packed, int):
        yield packed
        return
    place = 0
    while place < len(packed):
        value, place = _varint(packed, place)
        yield value


def read_matconvnet(path: Path) -> tuple[dict[str, Array], Array | None]:
    """Read ``{layer}.weight`` and ``{layer}.bias`` of all layers, and the mean colour.

    Weights come as (outputs, inputs, height, width), for RGB inputs as MatConvNet has them.

    Returns:
        The arrays, and RGB in 0-255, the mean over the mean image where the file has one; None
        where it has no mean.

    Raises:
        ValueError: If the file holds no such network; SciPy's errors if it is damaged.
    """
    wanted = ("layers", "meta", "normalization", "net")
    content: Mapping[str, Any] = scipy.io.loadmat(path, simplify_cells=True, variable_names=wanted)
    net = content.get("net", content)
    arrays: dict[str, Array] = {}
    for layer in net["layers"]:
        weights = layer.get("weights", ())
        if layer["type"] == "conv" and len(weights) == 2 and np.ndim(weights[0]) == 4:
            arrays[f"{layer['name']}.weight"] = np.ascontiguousarray(
                weights[0].transpose(3, 2, 0, 1)
            )
            arrays[f"{layer['name']}.bias"] = np.ravel(weights[1])
    if not arrays:
        raise ValueError("no convolutions")
    return arrays, _mean(net)


def _mean(net: Mapping[str, Any]) -> Array | None:
    """The mean colour; newer files keep it one level deeper."""
    normalization = net.get("meta", net).get("normalization", {})
    image = np.asarray(normalization.get("averageImage", ()), dtype=np.float64)
    if image.size == 0 or image.shape[-1] != 3:
        return None
    mean: Array = image.reshape(-1, 3).mean(axis=0)
    return mean


EPSILON = 1e-3  # of the variance, as in TensorFlow's network
# Which normalisation follows a convolution, by the last part of their names.
NORM_AFTER = {
    "_conv_stem": "_bn0",
    "_expand_conv": "_bn0",
    "_depthwise_conv": "_bn1",
    "_project_conv": "_bn2",
}


def fold_statistics(content: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Weight and bias of every convolution that gives what it and its normalisation gave.

    Args:
        content: Tensors by their names in the file.

    Returns:
        ``CONVOLUTION.weight`` and ``CONVOLUTION.bias`` in float64. A convolution whose
        normalisation is not in the file, or is of another size, has no bias.
    """
    folded = {}
    for name, weight in content.items():
        conv, _, kind = name.rpartition(".")
        place, dot, last = conv.rpartition(".")
        if kind != "weight" or last not in NORM_AFTER:
            continue
        folded[name] = weight.double()
        norm = f"{place}{dot}{NORM_AFTER[last]}"
        keys = [f"{norm}.{key}" for key in ("weight", "bias", "running_mean", "running_var")]
        found = [content[key].double() for key in keys if key in content]
        if len(found) == len(keys) and all(each.shape == weight.shape[:1] for each in found):
            gain, shift, mean, variance = found
            scale = gain / torch.sqrt(variance + EPSILON)
            folded[name] = weight.double() * scale[:, None, None, None]
            folded[f"{conv}.bias"] = shift - scale * mean
    return folded
