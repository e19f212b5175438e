"""Run networks on large inputs in pieces, with margins that keep every prediction the same.

A piece begins at a multiple of the network's stride, where the grids of all its layers coincide
with those of the whole. Inside the input its edge is padded with zeros where the whole has pixels;
predictions that this reaches are computed and thrown away.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod

from torch import Tensor, nn

from tex_lightning.networks.blocks import SameConv2d, Window

MARGINS = 2  # receptive fields along an axis of a piece; of less, most is computed several times


@dataclass(frozen=True)
class Span:
    """The extent of a piece along one axis.

    Attributes:
        begin: First element of the input that it reads.
        end: One past the last element.
        first: First position of the output that it gives.
        last: One past the last position.
        skip: Positions of its own output before ``first``.
    """

    begin: int
    end: int
    first: int
    last: int
    skip: int


def layer_windows(network: nn.Module, axis: int) -> list[Window]:
    """Geometry along one axis of every convolution and pooling of a network, in order.

    Args:
        network: HapticNet, VisualNet or a part of them.
        axis: 0 for bands and rows, 1 for frames and columns.
    """
    return list(_windows(network, axis))


def _windows(module: nn.Module, axis: int) -> Iterator[Window]:
    if isinstance(module, nn.Conv2d | nn.MaxPool2d | nn.AvgPool2d):
        kernel, stride, padding = (
            value if isinstance(value, int) else int(value[axis])
            for value in (module.kernel_size, module.stride, module.padding)
        )
        ceil = not isinstance(module, nn.Conv2d) and module.ceil_mode
        beyond = module.beyond if isinstance(module, SameConv2d) else 0
        yield Window(kernel, stride, padding, ceil, beyond)
        return
    for part in module.children():
        yield from _windows(part, axis)


def receptive_field(windows: Iterable[Window]) -> int:
    """Elements along one axis that one position of layers in a row depends on."""
    reach = 1
    for window in reversed(list(windows)):
        reach = (reach - 1) * window.stride + window.kernel
    return reach


def affordable(windows: tuple[Sequence[Window], Sequence[Window]], most: int | None) -> int | None:
    """Largest H * W of a piece, raised where a piece would be mostly margin.

    The receptive field of EfficientNet-Lite2 is 1307 pixels along each axis: with pieces of two
    million pixels, a photo of eight million would be computed 178 times over.

    Args:
        windows: The layers along H and along W.
        most: The requested size; None does not divide.
    """
    if most is None:
        return None
    return max(most, prod(MARGINS * receptive_field(each) for each in windows))


def split_axis(windows: Sequence[Window], size: int, pieces: int) -> list[Span]:
    """Divide the output along one axis into ``pieces`` and say what input each of them needs.

    Args:
        windows: The layers along this axis.
        size: Elements of the input.
        pieces: At least 1 and at most the number of output positions.
    """
    count = _positions(windows, size)
    stride = prod(window.stride for window in windows)
    margin = 0  # positions from the left edge that padding reaches
    for window in windows:
        margin = -(-(margin + window.padding) // window.stride)
    kept = [(count * piece // pieces, count * (piece + 1) // pieces) for piece in range(pieces)]
    begins = [max(0, first - margin) * stride for first, _ in kept]
    ends = [min(size, _reach(windows, last)) for _, last in kept]
    # pieces of the same size, the last up to a stride longer: every new size costs buffers anew
    length = max(end - begin for begin, end in zip(begins, ends, strict=True))
    latest = (size - length) // stride * stride
    begins = [min(begin, latest) for begin in begins]
    ends = [max(end, min(size, begin + length)) for begin, end in zip(begins, ends, strict=True)]
    return [
        Span(begin, end, first, last, first - begin // stride)
        for begin, end, (first, last) in zip(begins, ends, kept, strict=True)
    ]


def _reach(windows: Sequence[Window], last: int) -> int:
    """One past the last input that the first ``last`` positions depend on, were there no end."""
    for window in reversed(windows):
        last = (last - 1) * window.stride - window.padding + window.kernel
    return last


def _positions(windows: Sequence[Window], size: int) -> int:
    for window in windows:
        size = window.output(size)
    return size


def in_tiles(
    function: Callable[[Tensor], Tensor],
    x: Tensor,
    windows: tuple[Sequence[Window], Sequence[Window]],
    most: int | None,
) -> Tensor:
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
    rows, columns = _plan(windows, (x.shape[2], x.shape[3]), most)
    if len(rows) == len(columns) == 1:
        return function(x)
    whole: Tensor | None = None
    for row, column in product(rows, columns):
        part = function(x[:, :, row.begin : row.end, column.begin : column.end])
        if whole is None:
            whole = part.new_empty(*part.shape[:2], rows[-1].last, columns[-1].last)
        whole[:, :, row.first : row.last, column.first : column.last] = part[
            :, :, _kept(row), _kept(column)
        ]
    assert whole is not None  # there is at least one piece
    return whole


def _kept(span: Span) -> slice:
    return slice(span.skip, span.skip + span.last - span.first)


def _plan(
    windows: tuple[Sequence[Window], Sequence[Window]], size: tuple[int, int], most: int | None
) -> tuple[list[Span], list[Span]]:
    """Divide the longer side of the largest piece until every piece is small enough."""
    limits = [_positions(windows[axis], size[axis]) for axis in (0, 1)]
    pieces = [1, 1]
    while True:
        spans = [split_axis(windows[axis], size[axis], pieces[axis]) for axis in (0, 1)]
        longest = [max(span.end - span.begin for span in axis) for axis in spans]
        divisible = [axis for axis in (0, 1) if pieces[axis] < limits[axis]]
        if most is None or size[0] * size[1] <= most or not divisible:
            return spans[0], spans[1]
        if prod(longest) <= most:
            return spans[0], spans[1]
        pieces[max(divisible, key=lambda axis: longest[axis])] += 1
