"""Receptive fields: which input a position depends on, and how a large input is divided into tiles.

They follow from the convolutions and poolings of a network, in the order of its modules. A network
of a user may call its layers otherwise, so it is tried on random inputs: if its tiles do not give
the scores of the whole input, inputs are not divided.

A tile begins at a multiple of the network's stride, where the grids of all layers coincide with
those of the whole input. Its edges are padded with zeros where the whole input has pixels. The
positions that depend on such an edge are computed and dropped.
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count, product
from math import prod
from typing import Any

import torch
from torch import Tensor, nn

from tex_lightning.networks.blocks import SameConv2d, Window, independent_copy, is_builtin

MAX_ELEMENTS = 1 << 22  # of an input that is tried
MARGINS = 2  # receptive fields along an axis of a piece; of less, most is computed several times
Layers = tuple[Sequence[Window], Sequence[Window]]  # along rows and along columns
Run = Callable[[Tensor], Tensor]  # (1, C, H, W) to (1, D, M, N)
# Of a piece: elements of the input that it reads, positions that it gives, these in its own output.
Span = tuple[slice, slice, slice]


@dataclass(frozen=True)
class Geometry:
    """Geometry of a dense network.

    Attributes:
        layers: Windows in a row along rows and along columns, of its layers or of the whole.
        window_size: Height and width of an input that gives exactly one position.
        min_size: Height and width of the smallest input that gives a position.
    """

    layers: Layers
    window_size: tuple[int, int]
    min_size: tuple[int, int]

    @property
    def stride(self) -> int:
        """Elements of the input between neighbouring positions."""
        return prod(window.stride for window in self.layers[1])

    @property
    def receptive_field(self) -> int:
        """Columns that one position depends on."""
        return receptive_field(self.layers[1])

    def output_size(self, height: int, width: int) -> tuple[int, int]:
        """Return rows and columns of positions; 0 where the input is too small."""
        sizes = zip((height, width), self.min_size, self.layers, strict=True)
        rows, columns = (
            side_after(layers, size) if size >= least else 0 for size, least, layers in sizes
        )
        return rows, columns


def geometry_of(
    network: nn.Module, example: Callable[[], Tensor], *, rows_vary: bool
) -> Geometry | None:
    """Return the geometry of a network, or None where pieces would not give what the whole does.

    Args:
        network: In evaluation mode. What is found is kept with it, also in its copies.
        example: Makes an input (1, C, H, W) of it.
        rows_vary: Whether inputs may have any height; else they have that of the example.
    """
    values, window = vars(network), declared_size(network, "window_size")
    if is_builtin(network):  # of those without a window some see the whole input
        height = None if rows_vary or window is None else window[0]
        return window and layer_geometry(network, window, height)
    if "probed_geometry" not in values:
        values["probed_geometry"] = None
        with suppress(Exception), torch.inference_mode():  # it raises again where it is used
            values["probed_geometry"] = _probe(network, example(), window, rows_vary=rows_vary)
    geometry: Geometry | None = values["probed_geometry"]
    return geometry


def layer_geometry(
    network: nn.Module, window: tuple[int, int] | None, height: int | None
) -> Geometry:
    """Return the geometry that the convolutions and poolings of a network tell.

    Args:
        network: A network whose layers run in the order of its modules.
        window: Height and width that are meant to give exactly one position; where they do not, the
            smallest input is the window.
        height: Height of every input; None where it varies.
    """
    layers = layer_windows(network, 0), layer_windows(network, 1)
    rows, columns = (smallest_side(windows) for windows in layers)
    least = rows if height is None else height, columns
    geometry = Geometry(layers, window or least, least)
    alone = geometry.output_size(*geometry.window_size) == (1, 1)
    return geometry if alone else replace(geometry, window_size=least)


def declared_size(network: nn.Module, name: str) -> tuple[int, int] | None:
    """Return the height and width that an attribute of a network declares; None if it has none."""
    size = getattr(network, name, None)
    if not isinstance(size, Sequence) or [type(side) for side in size] != [int, int]:
        return None
    return size[0], size[1]


def _probe(
    network: nn.Module, example: Tensor, window: tuple[int, int] | None, *, rows_vary: bool
) -> Geometry | None:
    """Return the geometry that the layers of a network tell, if it cuts and counts as they do."""
    network = independent_copy(network).eval()  # it may keep what it is given
    geometry = layer_geometry(network, window, None if rows_vary else example.shape[2])
    axes = (0, 1) if rows_vary else (1,)
    holds = all(
        _holds(network, geometry, example, axis, more)
        for axis, more in product(axes, (0, geometry.stride // 2 + 1))
    )
    return geometry if holds else None


def _holds(network: Any, geometry: Geometry, example: Tensor, axis: int, more: int) -> bool:  # noqa: ANN401
    """Return whether pieces along an axis give what the whole does."""

    def run(x: Tensor, level: str = "fc3") -> Tensor:
        features: Tensor = network.features(x, level)
        return features[:, :, None] if features.dim() == 3 else features

    size, layers = list(geometry.min_size), geometry.layers
    size[axis] += 2 * receptive_field(layers[axis]) + 6 * geometry.stride + more
    if prod(size) > MAX_ELEMENTS:
        return False
    generator = torch.Generator().manual_seed(0)
    x = torch.randn(1, example.shape[1], *size, generator=generator).to(example)
    whole, pieces = run(x), in_tiles(run, x, layers, prod(size) * 2 // 3)
    limit = 1e-3 * float(whole.abs().max()) + 1e-6
    sizes = geometry.output_size(size[0], size[1])
    same = whole.shape[2:] == pieces.shape[2:] == run(x, "fc2").shape[2:] == sizes
    return same and bool(((whole - pieces).abs() <= limit).all())


def layer_windows(network: nn.Module, axis: int) -> list[Window]:
    """Return the geometry along one axis of every convolution and pooling of a network, in order.

    Args:
        network: A network or a part of one.
        axis: 0 for bands and rows, 1 for frames and columns.
    """
    windows = []
    for layer in network.modules():
        if isinstance(layer, nn.Conv2d | nn.MaxPool2d | nn.AvgPool2d):
            kernel, stride, padding = (
                value if isinstance(value, int) else int(value[axis])
                for value in (layer.kernel_size, layer.stride, layer.padding)
            )
            ceil = not isinstance(layer, nn.Conv2d) and layer.ceil_mode
            beyond = layer.beyond if isinstance(layer, SameConv2d) else 0
            windows.append(Window(kernel, stride, padding, ceil, beyond))
    return windows


def receptive_field(windows: Sequence[Window]) -> int:
    """Count the elements along one axis that one position of layers in a row depends on."""
    reach = 1
    for window in reversed(windows):
        reach = (reach - 1) * window.stride + window.kernel
    return reach


def side_after(windows: Iterable[Window], side: int) -> int:
    """Return how many places layers in a row take on an axis of ``side``; 0 if it is too small."""
    for window in windows:
        side = window.output(side)
    return side


def smallest_side(windows: Sequence[Window], places: int = 1) -> int:
    """Return the smallest side on which layers in a row take so many places."""
    return next(side for side in count(1) if side_after(windows, side) >= places)


def affordable(windows: Layers, most: int | None) -> int | None:
    """Return the largest H * W of a piece, raised where a piece would be mostly margin.

    The receptive field of EfficientNet-Lite2 is 1307 pixels along each axis: with pieces of two
    million pixels, a photo of eight million would be computed 178 times over.

    Args:
        windows: The layers along H and along W.
        most: The requested size; None does not divide.
    """
    return most and max(most, prod(MARGINS * receptive_field(axis) for axis in windows))


def split_axis(windows: Sequence[Window], size: int, pieces: int) -> list[Span]:
    """Divide the output along one axis into ``pieces``.

    Args:
        windows: The layers along this axis.
        size: Elements of the input.
        pieces: At least 1 and at most the number of output positions.

    Returns:
        For every piece the elements of the input that it reads, the positions that it gives, and
        where these stand in its own output.
    """
    count = side_after(windows, size)
    stride = prod(window.stride for window in windows)
    margin = padded_positions(windows)
    spans = []
    for piece in range(pieces):
        first, last = count * piece // pieces, count * (piece + 1) // pieces
        skip = min(first, margin)
        read = slice((first - skip) * stride, min(size, reach(windows, last)))
        spans.append((read, slice(first, last), slice(skip, skip + last - first)))
    return spans


def padded_positions(windows: Sequence[Window]) -> int:
    """Return how many positions the padding at the left edge reaches."""
    margin = 0
    for window in windows:
        margin = -(-(margin + window.padding) // window.stride)
    return margin


def reach(windows: Sequence[Window], last: int) -> int:
    """Return one past the last input index of the first ``last`` positions, without an end."""
    for window in reversed(windows):
        last = (last - 1) * window.stride - window.padding + window.kernel
    return last


def in_tiles(function: Run, x: Tensor, windows: Layers, most: int | None) -> Tensor:
    """Apply a network to a large input piece by piece.

    Args:
        function: Maps (1, C, H, W) to (1, D, M, N) or (1, D, N), however large H and W.
        x: The whole input.
        windows: Layers of the network along H and along W.
        most: Largest H * W of a piece; None does not divide. A piece is larger where a single
            prediction needs more.

    Returns:
        The result of ``function(x)``, except for rounding.
    """
    spans = _plan(windows, x.shape[2:], most)
    if len(spans[0]) == len(spans[1]) == 1:
        return function(x)
    rows, columns = (axis[-1][1].stop for axis in spans)
    whole = x.new_empty(0)
    for (top, row, own_row), (left, column, own_column) in product(*spans):
        part = function(x[:, :, top, left])
        part = part[:, :, None] if part.dim() == 3 else part
        if not whole.numel():
            whole = part.new_empty(*part.shape[:2], rows, columns)
        whole[:, :, row, column] = part[:, :, own_row, own_column]
    return whole


def _plan(windows: Layers, size: Sequence[int], most: int | None) -> list[list[Span]]:
    """Divide the longer side of the largest piece until every piece is small enough."""
    limits = [side_after(windows[axis], size[axis]) for axis in (0, 1)]
    pieces = [1, 1]
    while True:
        spans = [split_axis(windows[axis], size[axis], pieces[axis]) for axis in (0, 1)]
        longest = [max(read.stop - read.start for read, _, _ in axis) for axis in spans]
        divisible = [axis for axis in (0, 1) if pieces[axis] < limits[axis]]
        if most is None or not divisible or prod(longest) <= most or prod(size) <= most:
            return spans
        pieces[max(divisible, key=lambda axis: longest[axis])] += 1
