"""Convolutions of 3x3 with half the multiplications, by Winograd's method along time or columns.

Four neighbouring outputs of a filter with three taps are products of polynomials: 12
multiplications, or 6 if the polynomials are multiplied as their values at 0, infinity, 1,
-1, 2 and -2 (F(4, 3) of Winograd, Arithmetic Complexity of Computations, 1980; as convolutions over
channels in Lavin and Gray, Fast Algorithms for Convolutional Neural Networks, 2016). Across the
rows (the bands of a spectrogram) the filter stays as it is: in both directions there would be a
quarter of the products, but more additions than they save, and more rounding.
"""

from collections.abc import Sequence
from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from tex_lightning.inference.pooling import FastPool, halve, larger_of_pairs

TILE = 4  # columns that are computed together, two after pooling
# Values (6, 3) of a filter at the six points, with the divisors of the interpolation.
FILTER_VALUES = (
    (1 / 4, 0, 0),
    (0, 0, 1),
    (-1 / 6, -1 / 6, -1 / 6),
    (-1 / 6, 1 / 6, -1 / 6),
    (1 / 24, 1 / 12, 1 / 6),
    (1 / 24, -1 / 12, 1 / 6),
)
# Products that the interpolation no longer needs when it writes each of the four places.
READ = (0, 5, 3, 4)
# Bytes of a block's inputs or outputs, whichever have more channels: with the products six or seven
# times as much, which the cache still holds.
BLOCK = 1 << 22
# Multiply-accumulates for each thread, below which the thirty calls of a block cost more than half
# of the products.
MIN_MACS = 3 << 26


class SharedConv(nn.Conv2d):
    """A convolution of stride 1 that computes another way with the parameters of ``conv``."""

    def __init__(self, conv: nn.Conv2d) -> None:
        kernel = cast(tuple[int, int], conv.kernel_size)
        padding = cast(tuple[int, int], conv.padding)
        # without drawing weights, which would change the random numbers that come after
        super().__init__(
            conv.in_channels,
            conv.out_channels,
            kernel,
            padding=padding,
            groups=conv.groups,
            device="meta",
        )
        self.weight, self.bias = conv.weight, conv.bias


class WinogradConv(SharedConv):
    """A 3x3 convolution with padding 1, alone or with the max pooling by 2x2 that follows it.

    Pooling comes along because the outputs are computed apart for each place in a tile: the
    larger of two places is the pooling, and they need not be put in order first.

    Args:
        conv: The convolution; the parameters are shared with it.
        pooled: Whether to pool.
    """

    values: Tensor

    def __init__(self, conv: nn.Conv2d, *, pooled: bool = False) -> None:
        super().__init__(conv)
        self.pooled = pooled
        points = conv.weight.new_tensor(FILTER_VALUES, dtype=torch.float64)
        values = torch.einsum("pt,oibt->poib", points, conv.weight.detach().double())
        filters = values.to(conv.weight.dtype).flatten(0, 1)[..., None]
        filters = filters.contiguous(memory_format=torch.channels_last)
        self.register_buffer("values", filters, persistent=False)  # (6 O, I, 3, 1)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, I, H, W) to (B, O, H, W), pooled to halves rounded up; channels innermost."""
        batch, _, rows, columns = x.shape
        macs = batch * rows * columns * self.weight.numel()
        if macs < MIN_MACS * torch.get_num_threads():
            direct: Tensor = super().forward(x)
            return halve(direct) if self.pooled else direct
        tiles = -(-columns // TILE)
        whole = tiles * TILE
        if self.pooled:
            rows, columns, whole = -(-rows // 2), -(-columns // 2), -(-columns // 2)
        out = x.new_empty(batch, rows, whole, self.out_channels)
        self._fill(out, x.permute(0, 2, 3, 1), tiles)
        return out[:, :, :columns].permute(0, 3, 1, 2)

    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def _fill(self, out: Tensor, x: Tensor, tiles: int) -> None:
        """Compute (B, H, 4 tiles, O), or halves of (B, H, W, O), block by block."""
        rows, columns = x.shape[1:3]
        size = rows * max(self.in_channels, self.out_channels) * x.element_size()
        images = max(1, BLOCK // (size * tiles))
        block = -(-tiles // -(-size * tiles // BLOCK))  # all of nearly the same length
        step = TILE // 2 if self.pooled else TILE
        for image in range(0, len(x), images):
            part = slice(image, image + images)
            for begin in range(0, tiles, block):
                end = min(begin + block, tiles)
                into = out[part, :, step * begin : step * end]
                products = self._products(_at_points(_columns(x[part], begin, end)))
                if self.pooled:
                    places = [products[number] for number in READ]
                    _interpolate(products, places)
                    _pool(places, into, max(0, TILE * end - columns))
                else:
                    _interpolate(products, [into[:, :, place::TILE] for place in range(TILE)])

    def _products(self, points: Tensor) -> list[Tensor]:
        """Convolve the values (6, B, H, tiles, I) at the points: (B, H, tiles, O) each."""
        products = []
        for point, (x, values) in enumerate(zip(points, self.values.chunk(6), strict=True)):
            # the value at 1 goes into every place once, as the bias does
            bias = self.bias if point == 2 else None
            product = functional.conv2d(
                x.permute(0, 3, 1, 2), values, bias, padding=(1, 0), groups=self.groups
            )
            products.append(product.permute(0, 2, 3, 1))
        return products


class Pooled(FastPool):
    """The place of a max pooling that :class:`WinogradConv` has done; it tells the geometry."""

    def forward(self, x: Tensor) -> Tensor:
        """Leave everything as it is."""
        return x


def _columns(x: Tensor, begin: int, end: int) -> list[Tensor]:
    """Cut the six columns that a tile sees, zeros beyond the ends.

    Args:
        x: (B, H, W, I).
        begin: First tile.
        end: One past the last.

    Returns:
        (B, H, tiles, I) for each column, from that before the tile on.
    """
    # every fourth column in a row: runs of memory that are longer than a column's channels
    count = end - begin + 1
    phases = x.new_empty(TILE, *x.shape[:2], count, x.shape[3])
    for number, phase in enumerate(phases):
        first = TILE * begin + number - 1
        before = int(first < 0)
        known = x[:, :, first + TILE * before : first + TILE * count : TILE]
        after = before + known.shape[2]
        phase[:, :, before:after] = known
        phase[:, :, :before] = 0
        phase[:, :, after:] = 0
    return [*phases[:, :, :, :-1], *phases[:2, :, :, 1:]]


def _at_points(columns: Sequence[Tensor]) -> Tensor:
    """Transform the columns (B, H, tiles, I) to values (6, B, H, tiles, I) at the points."""
    first, second, third, fourth, fifth, sixth = columns
    points: Tensor = fifth.new_empty(6, *fifth.shape)
    zero, infinity, one, minus_one, two, minus_two = points
    odd = fourth - second
    even = torch.sub(fifth, third, out=one)
    torch.sub(even, torch.sub(third, first, out=zero), alpha=4, out=zero)
    torch.sub(torch.sub(sixth, fourth, out=infinity), odd, alpha=4, out=infinity)
    torch.add(even, odd, alpha=2, out=two)
    torch.sub(even, odd, alpha=2, out=minus_two)
    even = torch.sub(fifth, third, alpha=4, out=one)
    odd = torch.sub(fourth, second, alpha=4, out=odd)
    torch.sub(even, odd, out=minus_one)
    even.add_(odd)
    return points


def _interpolate(products: Sequence[Tensor], places: Sequence[Tensor]) -> None:
    """Compute (B, H, tiles, O) for the four places in a tile from the products at the points.

    Args:
        products: (B, H, tiles, O) for each point; overwritten.
        places: Where to, of that shape.
    """
    zero, infinity, one, minus_one, two, minus_two = products
    even, odd = one + minus_one, one.sub_(minus_one)
    even_two, odd_two = torch.add(two, minus_two, out=minus_one), two.sub_(minus_two)
    torch.add(zero.add_(even), even_two, out=places[0])
    torch.add(odd, odd_two, alpha=2, out=places[1])
    torch.add(even, even_two, alpha=4, out=places[2])
    torch.add(odd.add_(infinity), odd_two, alpha=8, out=places[3])


def _pool(places: Sequence[Tensor], out: Tensor, missing: int) -> None:
    """Max pooling over rows and columns.

    Args:
        places: (B, H, tiles, O) for each of the four places in a tile; overwritten.
        out: (B, H / 2, 2 tiles or one less, O).
        missing: The last so many places of the last tile lie beyond the end.
    """
    for place in places[TILE - missing :]:
        place[:, :, -1] = -torch.inf
    first, second, third, fourth = places
    batch, rows, tiles, channels = first.shape
    columns = first.new_empty(batch, rows, 2 * tiles, channels)
    torch.maximum(first, second, out=columns[:, :, 0::2])
    torch.maximum(third, fourth, out=columns[:, :, 1::2])
    columns = columns[:, :, : out.shape[2]]
    larger_of_pairs(columns, 1, out)
