"""Local response normalisation in pieces that stay in the processor's cache."""

import torch
from torch import Tensor, nn

PIECE = 1 << 18  # elements; a few float32 buffers of this size fit a second-level cache


class FastResponseNorm(nn.Module):
    """``x / (k + alpha / size * sum of the squares of size channels)^0.75``, as PyTorch has it.

    PyTorch averages over a padded copy with the channels as a spatial axis, and raises to a power
    with logarithms. Here four shifted additions give the sum and two roots the power, on pieces
    of the image with the channels innermost.

    Args:
        size: Odd number of channels in the sum, 5.
        alpha: Factor of the mean square.
        beta: 0.75 only.
        k: Constant.
    """

    def __init__(self, size: int, alpha: float, beta: float, k: float) -> None:
        super().__init__()
        if size != 5 or beta != 0.75:
            raise ValueError(f"size {size} and beta {beta} are not those of AlexNet")
        self.scale = alpha / size
        self.k = k

    def forward(self, x: Tensor) -> Tensor:
        """Normalise (B, C, H, W) across C."""
        pixels = x.permute(0, 2, 3, 1).contiguous().flatten(0, 2)
        out = torch.empty_like(pixels)
        count = max(1, PIECE // pixels.shape[1])
        for piece, target in zip(torch.split(pixels, count), torch.split(out, count), strict=True):
            torch.mul(piece, self._factor(piece), out=target)
        return out.view(x.shape[0], *x.shape[2:], x.shape[1]).permute(0, 3, 1, 2)

    def _factor(self, pixels: Tensor) -> Tensor:
        """(P, C) by which the values are multiplied."""
        channels = pixels.shape[1]
        squares = pixels.new_zeros(len(pixels), channels + 4)
        inner = squares[:, 2:-2]
        torch.mul(pixels, pixels, out=inner)
        pairs = squares[:, :-1] + squares[:, 1:]
        total = pairs[:, :channels] + pairs[:, 2 : channels + 2]
        root = total.add_(squares[:, 4:]).mul_(self.scale).add_(self.k).rsqrt_()
        return root.mul_(root.sqrt())
