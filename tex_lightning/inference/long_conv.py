"""HapticNet's 4x12 convolution as matrix products: fewer of them for a long trace.

It reads all four bands at once, so that a frame with its bands and channels is one row of numbers,
and a place in the filter is one matrix that all rows are multiplied with. No row is copied for the
twelve frames that it is part of. For the few seconds of a stroke the general convolution takes 1.4
to 1.6 times as long.

Over a long trace there are 5/9 of the multiplications by Winograd's method: three taps and three
outputs are 9, or 5 as values at 0, 1, -1, 2 and infinity (F(3, 3), see :mod:`.winograd`). A filter
of 12 taps is four such filters, each three frames later than the one before. That is one tile
later, so their inputs at the points are the same values, put side by side as the rows of a matrix
product.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from tex_lightning.inference.winograd import MIN_MACS, SharedConv

FEW = 64  # rows, up to which products of rows are quicker than the general convolution
TILE = 3  # taps of a part of the filter, and outputs computed together
FILTER_VALUES = (
    (1 / 2, 0, 0),
    (-1 / 2, -1 / 2, -1 / 2),
    (-1 / 6, 1 / 6, -1 / 6),
    (1 / 6, 1 / 3, 2 / 3),
    (0, 0, 1),
)
FRAME_VALUES = (
    (2, -1, -2, 1, 0),
    (0, -2, -1, 1, 0),
    (0, 2, -3, 1, 0),
    (0, -1, 0, 1, 0),
    (0, 2, -1, -2, 1),
)
OUTPUTS = ((1, 1, 1, 1, 0), (0, 1, -1, 2, 0), (0, 1, 1, 4, 1))


class LongConv(SharedConv):
    """A convolution without padding, over all bands and a multiple of three frames.

    Args:
        conv: The convolution; the parameters are shared with it.
    """

    places: Tensor
    values: Tensor

    def __init__(self, conv: nn.Conv2d) -> None:
        super().__init__(conv)
        self.parts = self.kernel_size[1] // TILE
        points = conv.weight.new_tensor(FILTER_VALUES, dtype=torch.float64)
        parts = conv.weight.detach().double().reshape(*conv.weight.shape[:3], self.parts, TILE)
        values = torch.einsum("pt,oibnt->pnbio", points, parts).to(conv.weight.dtype)
        self.register_buffer("values", values.flatten(1, 3).contiguous(), persistent=False)
        places = conv.weight.detach().permute(3, 2, 1, 0).flatten(1, 2).contiguous()
        self.register_buffer("places", places, persistent=False)  # (taps, bands I, O)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, I, bands, T) to (B, O, 1, T - taps + 1)."""
        batch, count = len(x), x.shape[3] - self.kernel_size[1] + 1
        macs = count * self.weight.numel()
        if x.shape[2] > self.kernel_size[0]:
            return super().forward(x)
        if batch == 1 and macs >= MIN_MACS * torch.get_num_threads():
            outputs: Tensor = self._products(x[0].permute(2, 1, 0))
            return outputs.T[None, :, None]
        return self._by_rows(x) if batch * count <= FEW else super().forward(x)

    def _by_rows(self, x: Tensor) -> Tensor:
        """Add up the products of all rows with each place of the filter."""
        batch, count = len(x), x.shape[3] - self.kernel_size[1] + 1
        rows = x.permute(3, 0, 2, 1).flatten(2)  # (T, B, bands I)
        sums = rows[:count].flatten(0, 1) @ self.places[0]
        for place, values in enumerate(self.places[1:], 1):
            sums.addmm_(rows[place : place + count].flatten(0, 1), values)
        if self.bias is not None:
            sums += self.bias
        return sums.view(count, batch, 1, -1).permute(1, 3, 2, 0)

    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def _products(self, x: Tensor) -> Tensor:
        """Map (T, bands, I) to (T - taps + 1, O)."""
        count = len(x) - self.kernel_size[1] + 1
        tiles = -(-count // TILE)
        seen = tiles + self.parts - 1  # tiles of input, which reach two frames beyond
        beyond = TILE * seen + 2 - len(x)
        frames = functional.pad(x.flatten(1), (0, 0, 0, beyond)).unfold(0, TILE + 2, TILE)
        frames = frames.permute(2, 0, 1).contiguous()
        points = torch.einsum("pf,fti->pti", x.new_tensor(FRAME_VALUES), frames).contiguous()
        size = points.shape[2]
        rows = points.as_strided((5, tiles, self.parts * size), (seen * size, size, 1))
        # copied side by side: the products of overlapping rows take a fifth longer
        products = torch.bmm(rows.contiguous(), self.values)
        places = torch.einsum("kp,pto->tko", x.new_tensor(OUTPUTS), products)
        outputs = places.flatten(0, 1)[:count]
        return outputs if self.bias is None else outputs + self.bias
