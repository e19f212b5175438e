"""Sizes of the maps that a module makes, found where nothing is computed: on the meta device."""

from collections.abc import Callable
from contextlib import suppress
from copy import deepcopy
from math import prod
from typing import NamedTuple

import torch
from torch import nn

MAX_SIDE = 1 << 13  # elements along an axis that are tried
MAX_ELEMENTS = 1 << 20  # of an input that is computed

Sizes = Callable[[tuple[int, ...]], tuple[int, ...] | None]
Count = Callable[[int], int]


class Steps(NamedTuple):
    """How many positions a module gives on an axis of ``size``: (size + shift) // stride.

    Attributes:
        min_size: Smallest size that gives one.
        stride: Elements of the input between neighbouring positions.
        shift: See above.
    """

    min_size: int
    stride: int
    shift: int


def map_sizes(module: nn.Module) -> Sizes:
    """Return a function from the shape of an input (B, C, ...) to the size of the map.

    It gives None for inputs that the module cannot take.
    """
    copies = {"meta": deepcopy(module).to("meta"), "cpu": deepcopy(module).cpu()}

    def sizes(shape: tuple[int, ...]) -> tuple[int, ...] | None:
        for device, copy in copies.items():  # values, which a module may ask for, are on one only
            if device == "meta" or prod(shape) <= MAX_ELEMENTS:
                with suppress(Exception), torch.no_grad():  # of a kernel larger than its input
                    found = copy(torch.zeros(shape, device=device))
                    return tuple(found.shape[2:]) if len(found) == shape[0] else None
        return None

    return sizes


def smallest(count: Count, least: int) -> int | None:
    """Return the smallest size that gives at least so many positions, if one does."""
    high = 1
    while count(high) < least:
        high *= 2
        if high > MAX_SIDE:
            return None
    low = high // 2  # too small, or 0
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if count(middle) >= least else (middle, high)
    return high


def measure_steps(count: Count) -> Steps | None:
    """Return the steps of an axis, or None where positions do not come at even distances."""
    first = smallest(count, 1)
    if first is None:
        return None
    begins = [smallest(count, count(first) + more) for more in (1, 2)]
    if begins[0] is None or begins[1] is None:
        return None
    stride = begins[1] - begins[0]
    if stride < 1:  # more positions than elements
        return None
    shift = stride * (count(first) + 1) - begins[0]
    tried = range(first, first + 3 * stride + 1, max(1, stride // 5))
    even = all(count(size) == (size + shift) // stride for size in tried)
    return Steps(first, stride, shift) if even else None
