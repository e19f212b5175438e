"""Convolutions of 3x3 with half the multiplications, by Winograd's method along time.

Four neighbouring outputs of a filter with three taps are products of polynomials: 12
multiplications, or 6 if the polynomials are multiplied as their values at 0, infinity, 1,
-1, 2 and -2 (F(4, 3) of Winograd, Arithmetic Complexity of Computations, 1980; as convolutions over
channels in Lavin and Gray, Fast Algorithms for Convolutional Neural Networks, 2016). Across the
bands the filter stays as it is: in both directions there would be a quarter of the products, but
more additions than they save, and more rounding.
"""

from collections.abc import Sequence
from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

TILE = 4  # frames that are computed together, two after pooling
# Values (6, 3) of a filter at the six points, with the divisors of the interpolation.
FILTER_VALUES = (
    (1 / 4, 0, 0),
    (0, 0, 1),
    (-1 / 6, -1 / 6, -1 / 6),
    (-1 / 6, 1 / 6, -1 / 6),
    (1 / 24, 1 / 12, 1 / 6),
    (1 / 24, -1 / 12, 1 / 6),
)
# Elements of each of a block's six inputs; longer blocks cost memory, not less time.
BLOCK = 1 << 19
# Multiply-accumulates for each thread, below which the thirty calls of a block cost more than half
# of the products.
LEAST_MACS = 3 << 26


class SharedConv(nn.Conv2d):
    """A convolution of stride 1 that computes another way with the parameters of ``conv``."""

    def __init__(self, conv: nn.Conv2d) -> None:
        kernel = cast(tuple[int, int], conv.kernel_size)
        padding = cast(tuple[int, int], conv.padding)
        # without drawing weights, which would change the random numbers that come after
        super().__init__(
            conv.in_channels, conv.out_channels, kernel, padding=padding, device="meta"
        )
        self.weight, self.bias = conv.weight, conv.bias


class WinogradConv(SharedConv):
    """A 3x3 convolution with padding 1, together with the max pooling by 2x2 that follows it.

    Pooling comes along because the outputs are computed apart for each place in a tile: the
    larger of two places is the pooling over time, and they need not be put in order first.

    Args:
        conv: The convolution; the parameters are shared with it.
    """

    values: Tensor

    def __init__(self, conv: nn.Conv2d) -> None:
        super().__init__(conv)
        points = conv.weight.new_tensor(FILTER_VALUES, dtype=torch.float64)
        values = torch.einsum("pt,oibt->poib", points, conv.weight.detach().double())
        filters = values.to(conv.weight.dtype).flatten(0, 1)[..., None]
        filters = filters.contiguous(memory_format=torch.channels_last)
        self.register_buffer("values", filters, persistent=False)  # (6 O, I, 3, 1)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, I, bands, T) to (B, O, bands / 2, T / 2), both rounded up, channels innermost."""
        batch, _, bands, frames = x.shape
        macs = batch * bands * frames * self.weight.numel()
        if macs < LEAST_MACS * torch.get_num_threads():
            direct: Tensor = super().forward(x)
            return functional.max_pool2d(direct, 2, 2, ceil_mode=True)
        pooled = x.new_empty(batch, -(-bands // 2), -(-frames // 2), self.out_channels)
        self._fill(pooled, x.permute(0, 2, 3, 1))
        return pooled.permute(0, 3, 1, 2)

    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def _fill(self, pooled: Tensor, x: Tensor) -> None:
        """Compute (B, bands / 2, T / 2, O) from (B, bands, T, I), block by block."""
        frames, size = x.shape[2], x[0, :, 0].numel()
        tiles = -(-frames // TILE)
        images = max(1, BLOCK // (size * tiles))
        block = -(-tiles // -(-size * tiles // BLOCK))  # all of nearly the same length
        for image in range(0, len(x), images):
            part = slice(image, image + images)
            for begin in range(0, tiles, block):
                end = min(begin + block, tiles)
                places = self._places(_at_points(_phases(x[part], begin, end)))
                into = pooled[part, :, 2 * begin : 2 * end]
                _pool(places, into, max(0, TILE * end - frames))

    def _places(self, points: Tensor) -> list[Tensor]:
        """Convolve the values at six points, and interpolate.

        Args:
            points: (6, B, bands, tiles, I).

        Returns:
            (B, bands, tiles, O) for each of the four places in a tile.
        """
        products = []
        for point, (x, values) in enumerate(zip(points, self.values.chunk(6), strict=True)):
            # the value at 1 goes into every place once, as the bias does
            bias = self.bias if point == 2 else None
            product = functional.conv2d(x.permute(0, 3, 1, 2), values, bias, padding=(1, 0))
            products.append(product.permute(0, 2, 3, 1))
        zero, infinity, one, minus_one, two, minus_two = products
        even, odd = one + minus_one, one.sub_(minus_one)
        even_two, odd_two = torch.add(two, minus_two, out=minus_one), two.sub_(minus_two)
        return [
            zero.add_(even).add_(even_two),
            torch.add(odd, odd_two, alpha=2, out=minus_two),
            even.add_(even_two, alpha=4),
            odd.add_(odd_two, alpha=8).add_(infinity),
        ]


class Pooled(nn.MaxPool2d):
    """The place of a max pooling that :class:`WinogradConv` has done; it tells the geometry."""

    def forward(self, x: Tensor) -> Tensor:
        """Leave everything as it is."""
        return x


def _phases(x: Tensor, begin: int, end: int) -> Tensor:
    """Every fourth frame, from the frame before the first tile on, with zeros beyond the ends.

    Args:
        x: (B, bands, T, I).
        begin: First tile.
        end: One past the last.

    Returns:
        (4, B, bands, tiles + 1, I); a tile sees six frames, two of them in the next tile.
    """
    count = end - begin + 1
    phases = x.new_empty(TILE, *x.shape[:2], count, x.shape[3])
    for number, phase in enumerate(phases):
        first = TILE * begin + number - 1
        before = int(first < 0)
        known = x[:, :, first + TILE * before : first + TILE * count : TILE]
        after = before + known.shape[2]
        phase[:, :, before:after] = known
        if before:
            phase[:, :, 0] = 0
        if after < count:
            phase[:, :, after:] = 0
    return phases


def _at_points(phases: Tensor) -> Tensor:
    """Transform (4, B, bands, tiles + 1, I) to values (6, B, bands, tiles, I) at the points."""
    first, second, third, fourth = phases[:, :, :, :-1]
    fifth, sixth = phases[:2, :, :, 1:]
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


def _pool(places: Sequence[Tensor], out: Tensor, missing: int) -> None:
    """Max pooling over time and bands.

    Args:
        places: (B, bands, tiles, O) for each of the four places in a tile; overwritten.
        out: (B, bands / 2, 2 tiles or one less, O).
        missing: The last so many places of the last tile lie beyond the end.
    """
    for place in places[TILE - missing :]:
        place[:, :, -1] = -torch.inf
    first, second, third, fourth = places
    batch, bands, tiles, channels = first.shape
    frames = first.new_empty(batch, bands, 2 * tiles, channels)
    torch.maximum(first, second, out=frames[:, :, 0::2])
    torch.maximum(third, fourth, out=frames[:, :, 1::2])
    frames = frames[:, :, : out.shape[2]]
    torch.maximum(frames[:, :-1:2], frames[:, 1::2], out=out[:, : bands // 2])
    if bands % 2:
        out[:, -1] = frames[:, -1]
