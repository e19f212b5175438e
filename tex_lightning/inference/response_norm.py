"""Local response normalisation in pieces that stay in the processor's cache."""

import torch
from torch import Tensor, nn

PIECE = 1 << 18  # elements; three float32 buffers of this size fit the cache of one processor


class FastResponseNorm(nn.Module):
    """``x / (k + alpha / 5 * sum of the squares of 5 channels)^0.75`` across channels.

    PyTorch averages over a padded copy with the channels as a spatial axis, and raises to a power
    with logarithms. Here three shifted additions give the sum and two roots the power, on pieces
    of the image with the channels innermost, whose buffers are used again and again.

    Args:
        layer: PyTorch's layer, of size 5 and beta 0.75 as in AlexNet.
    """

    def __init__(self, layer: nn.LocalResponseNorm) -> None:
        super().__init__()
        if layer.size != 5 or layer.beta != 0.75:
            raise ValueError(f"size {layer.size} and beta {layer.beta} are not those of AlexNet")
        self.scale = layer.alpha / layer.size
        self.k = layer.k

    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def forward(self, x: Tensor) -> Tensor:
        """Normalise (B, C, H, W) across C, in place where the channels are innermost."""
        pixels = x.permute(0, 2, 3, 1).contiguous()
        flat = pixels.flatten(0, 2)
        channels = flat.shape[1]
        count = len(flat)
        if x.device.type == "cpu":  # elsewhere many small pieces cost more than they save
            count = min(count, max(1, PIECE // channels))
        squares, pairs = flat.new_zeros(2, count, channels + 4, dtype=torch.float32)
        factor = flat.new_empty(count, channels, dtype=torch.float32)
        for piece in torch.split(flat, count):
            size = len(piece)
            self._normalise(piece, squares[:size], pairs[:size], factor[:size])
        return pixels.permute(0, 3, 1, 2)

    def _normalise(self, pixels: Tensor, squares: Tensor, pairs: Tensor, factor: Tensor) -> None:
        """Normalise (P, C) in place.

        Args:
            pixels: The values.
            squares: Buffer (P, C + 4) with zeros in the two columns at either end.
            pairs: Buffer of that size.
            factor: Buffer (P, C).
        """
        wide, channels = pixels.float(), pixels.shape[1]
        torch.mul(wide, wide, out=squares[:, 2:-2])
        # neighbours in memory, across the rows' ends as well: faster, and those are not read
        line = squares.view(-1)
        torch.add(line[:-1], line[1:], out=pairs.view(-1)[:-1])
        torch.add(pairs[:, :channels], pairs[:, 2 : channels + 2], out=factor)
        factor.add_(squares[:, 4:]).mul_(self.scale).add_(self.k).rsqrt_()
        fourth = torch.sqrt(factor, out=pairs[:, :channels])
        pixels.mul_(factor.mul_(fourth))
