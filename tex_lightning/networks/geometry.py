"""Which part of an input each prediction of a dense network depends on, and runs in pieces.

This package's networks say it by their layers. Of any other network it is found by trying: output
sizes on the meta device, where nothing is computed, then how far NaN in the input spreads. What is
found holds only if pieces of random inputs give the scores of the whole; else inputs are not cut.

A piece begins at a multiple of the network's stride, where the grids of all its layers coincide
with those of the whole. Inside the input its edge is padded with zeros where the whole has pixels;
predictions that this reaches are computed and thrown away.
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass
from itertools import product
from math import prod
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from tex_lightning.networks.blocks import SameConv2d, Window, is_builtin
from tex_lightning.networks.windows import Scores

MAX_SIDE = 1 << 13  # elements along an axis that are tried
MAX_COMPUTED = 1 << 20  # of an input that is computed to learn the size of a map
MAX_ELEMENTS = 1 << 22  # of an input that is tried
MARGINS = 2  # receptive fields along an axis of a piece; of less, most is computed several times
Layers = tuple[Sequence[Window], Sequence[Window]]  # along rows and along columns
Run = Callable[[Tensor], Tensor]  # (1, C, H, W) to (1, D, M, N)
Span = tuple[slice, slice, slice]  # of a piece: input read, output given, the same in its own


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
    values = vars(network)
    if is_builtin(network):
        if not hasattr(network, "window_size"):
            return None
        declared: Any = network
        layers = layer_windows(network, 0), layer_windows(network, 1)
        return Geometry(layers, declared.window_size, declared.min_size)
    if "probed_geometry" not in values:
        values["probed_geometry"] = None
        with suppress(Exception), torch.inference_mode():  # it raises again where it is used
            values["probed_geometry"] = probe_geometry(network, example(), rows_vary=rows_vary)
    found: Geometry | None = values["probed_geometry"]
    return found


def layer_windows(network: nn.Module, axis: int) -> list[Window]:
    """Geometry along one axis of every convolution and pooling of a network, in order.

    Args:
        network: HapticNet, VisualNet or a part of them.
        axis: 0 for bands and rows, 1 for frames and columns.
    """
    found = []
    for layer in network.modules():
        if isinstance(layer, nn.Conv2d | nn.MaxPool2d | nn.AvgPool2d):
            kernel, stride, padding = (
                value if isinstance(value, int) else int(value[axis])
                for value in (layer.kernel_size, layer.stride, layer.padding)
            )
            ceil = not isinstance(layer, nn.Conv2d) and layer.ceil_mode
            beyond = layer.beyond if isinstance(layer, SameConv2d) else 0
            found.append(Window(kernel, stride, padding, ceil, beyond))
    return found


def receptive_field(windows: Sequence[Window]) -> int:
    """Elements along one axis that one position of layers in a row depends on."""
    reach = 1
    for window in reversed(windows):
        reach = (reach - 1) * window.stride + window.kernel
    return reach


def side_after(windows: Iterable[Window], side: int) -> int:
    """Return how many places layers in a row take on an axis of ``side``; 0 if it is too small."""
    for window in windows:
        side = window.output(side)
    return side


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


def map_sizes(module: nn.Module) -> Callable[[tuple[int, ...]], tuple[int, ...] | None]:
    """Return a function from the shape of an input (B, C, ...) to the size of the map.

    It gives None for inputs that the module cannot take.
    """
    copies = {"meta": deepcopy(module).to("meta"), "cpu": deepcopy(module).cpu()}

    def sizes(shape: tuple[int, ...]) -> tuple[int, ...] | None:
        for device, copy in copies.items():  # values, which a module may ask for, are on one only
            if device == "meta" or prod(shape) <= MAX_COMPUTED:
                with suppress(Exception), torch.no_grad():  # of a kernel larger than its input
                    found = copy(torch.zeros(shape, device=device))
                    return tuple(found.shape[2:]) if len(found) == shape[0] else None
        return None

    return sizes


def smallest(count: Callable[[int], int], least: int) -> int | None:
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


def measure_steps(count: Callable[[int], int]) -> Steps | None:
    """Return the steps of an axis, or None where positions do not come at even distances."""
    if (first := smallest(count, 1)) is None:
        return None
    one, two = (smallest(count, count(first) + more) for more in (1, 2))
    if one is None or two is None or one == two:  # or more positions than elements
        return None
    stride = two - one
    shift = stride * (count(first) + 1) - one
    tried = range(first, first + 3 * stride + 1, max(1, stride // 5))
    even = all(count(size) == (size + shift) // stride for size in tried)
    return Steps(first, stride, shift) if even else None


def probe_geometry(network: nn.Module, example: Tensor, *, rows_vary: bool) -> Geometry | None:
    """Find the geometry of a network by trying; arguments are those of :func:`geometry_of`."""
    steps = _probe_steps(network, example, rows_vary=rows_vary)
    if steps is None:
        return None
    network = deepcopy(network).eval()  # which may keep something of what it is given
    run, (rows, columns) = _runner(network, "fc3"), steps
    least = rows.min_size, columns.min_size
    across = _measure_reach(run, example, steps, 1)
    down = _measure_reach(run, example, steps, 0) if rows_vary else Window(least[0], least[0])
    larger = least[0] + 2 * rows.stride * rows_vary, least[1] + 2 * columns.stride
    several = _noise(example, larger)
    if down is None or across is None or several is None:
        return None
    if _runner(network, "fc2")(several).shape[2:] != run(several).shape[2:]:
        return None
    found = Geometry(([down], [across]), getattr(network, "window_size", least), least)
    if found.output_size(*found.window_size) != (1, 1):
        found = Geometry(found.layers, least, least)
    axes = (0, 1) if rows_vary else (1,)
    return found if all(_holds(run, example, found, axis) for axis in axes) else None


def _probe_steps(
    network: nn.Module, example: Tensor, *, rows_vary: bool
) -> tuple[Steps, Steps] | None:
    """Find how many positions a network gives along rows and columns."""
    if example.dim() != 4:
        return None
    sizes, (channels, height) = map_sizes(Scores(network)), example.shape[1:3]

    def count(rows: int, columns: int, axis: int) -> int:
        found = sizes((2, channels, rows, columns))
        return 0 if found is None else (1, *found)[-2:][axis]

    rows: Steps | None = Steps(height, height, 0)
    if rows_vary:
        side = smallest(lambda size: count(size, size, 0), 1)
        if side is None:
            return None
        height, rows = side, measure_steps(lambda size: count(size, side, 0))
    columns = measure_steps(lambda size: count(height, size, 1))
    return None if rows is None or columns is None else (rows, columns)


def _runner(network: Any, level: str) -> Run:  # noqa: ANN401
    def run(x: Tensor) -> Tensor:
        found: Tensor = network.features(x, level)
        return found[:, :, None] if found.dim() == 3 else found.flatten(2, -2)

    return run


def _noise(example: Tensor, size: Sequence[int]) -> Tensor | None:
    if example.shape[1] * prod(size) > MAX_ELEMENTS:
        return None
    generator = torch.Generator().manual_seed(0)
    return torch.randn(1, example.shape[1], *size, generator=generator).to(example)


def _measure_reach(
    run: Run, example: Tensor, steps: tuple[Steps, Steps], axis: int
) -> Window | None:
    """One window that is as good as all layers along an axis.

    NaN in as many neighbouring elements as the stride reaches every position that reads one of
    them. The window may reach less than a stride farther than the network does.
    """
    min_size, stride, shift = steps[axis]
    size = [steps[0].min_size, steps[1].min_size]
    size[axis] = min_size + 8 * stride
    while (x := _noise(example, size)) is not None:
        begin = size[axis] // 2
        x.narrow(2 + axis, begin, stride).fill_(torch.nan)
        reached = run(x)[0].isnan().any(dim=0).any(dim=1 - axis).nonzero().flatten().tolist()
        if not reached:
            return None
        if reached[0] > 0 and reached[-1] < (size[axis] + shift) // stride - 1:
            before = max(0, stride * reached[-1] - begin)
            after = begin + stride - stride * reached[0]
            beyond = shift + after - before - stride
            return Window(before + after, stride, before, beyond=beyond)
        size[axis] *= 2
    return None


def _holds(run: Run, example: Tensor, geometry: Geometry, axis: int) -> bool:
    """Whether pieces along an axis give what the whole does, of an even and an odd size."""
    kernel, stride = geometry.layers[axis][0][:2]
    for more in (0, stride // 2 + 1):
        size = list(geometry.min_size)
        size[axis] += 2 * kernel + 6 * stride + more
        if (x := _noise(example, size)) is None:
            return False
        whole, pieces = run(x), in_tiles(run, x, geometry.layers, prod(size) * 2 // 3)
        limit = 1e-3 * float(whole.abs().max()) + 1e-6
        if whole.shape != pieces.shape or not bool(((whole - pieces).abs() <= limit).all()):
            return False
        if tuple(whole.shape[2:]) != geometry.output_size(size[0], size[1]):
            return False
    return True


def affordable(windows: Layers, most: int | None) -> int | None:
    """Largest H * W of a piece, raised where a piece would be mostly margin.

    The receptive field of EfficientNet-Lite2 is 1307 pixels along each axis: with pieces of two
    million pixels, a photo of eight million would be computed 178 times over.

    Args:
        windows: The layers along H and along W.
        most: The requested size; None does not divide.
    """
    return most and max(most, prod(MARGINS * receptive_field(each) for each in windows))


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
    margin = 0  # positions from the left edge that padding reaches
    for window in windows:
        margin = -(-(margin + window.padding) // window.stride)
    spans = []
    for piece in range(pieces):
        first, last = count * piece // pieces, count * (piece + 1) // pieces
        skip = min(first, margin)
        read = slice((first - skip) * stride, min(size, _reach(windows, last)))
        spans.append((read, slice(first, last), slice(skip, skip + last - first)))
    return spans


def _reach(windows: Sequence[Window], last: int) -> int:
    """One past the last input that the first ``last`` positions depend on, were there no end."""
    for window in reversed(windows):
        last = (last - 1) * window.stride - window.padding + window.kernel
    return last


def in_tiles(function: Run, x: Tensor, windows: Layers, most: int | None) -> Tensor:
    """Apply a network to a large input piece by piece.

    Args:
        function: Maps (1, C, H, W) to (1, D, M, N), however large H and W.
        x: The whole input.
        windows: Its layers along H and along W.
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
