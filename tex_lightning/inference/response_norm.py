"""Local response normalisation in pieces that stay in the processor's cache."""

from typing import Any

import torch
from torch import Tensor, nn

PIECE = 1 << 19  # elements; with three float32 buffers of this size the cache is not exceeded


class FastResponseNorm(nn.Module):
    """``x / (k + alpha / 5 * sum of the squares of 5 channels)^0.75`` across channels.

    PyTorch averages over a padded copy with the channels as a spatial axis, and raises to a power
    with logarithms. Here three shifted additions give the sum and two roots the power, on pieces
    of the image with the channels innermost, whose buffers are used again and again. Every channel
    brings a fifth of ``k`` into the sum, and so do the two beyond either end.

    Args:
        layer: PyTorch's layer, of size 5 and beta 0.75 as in AlexNet.
    """

    def __init__(self, layer: nn.LocalResponseNorm) -> None:
        super().__init__()
        if layer.size != 5 or layer.beta != 0.75:
            raise ValueError(f"size {layer.size} and beta {layer.beta} are not those of AlexNet")
        self.scale = layer.alpha / layer.size
        self.k = layer.k
        self.part = layer.k / layer.size

    def stay_uncompiled(self) -> None:
        """Keep torch.compile from what is done piece by piece, which makes no graph.

        Not a decorator: PyTorch's compiler, which that imports, takes a second to import.
        """
        uncompiled: Any = torch.compiler.disable(self.forward)  # type: ignore[no-untyped-call]
        self.forward = uncompiled  # type: ignore[method-assign]

    def forward(self, x: Tensor) -> Tensor:
        """Normalise (B, C, H, W) across C, in place where the channels are innermost."""
        pixels = x.permute(0, 2, 3, 1).contiguous()
        flat = pixels.flatten(0, 2)
        channels = flat.shape[1]
        count = len(flat)
        if x.device.type == "cpu":  # elsewhere many small pieces cost more than they save
            count = min(count, max(1, PIECE // channels))
        lines = flat.new_full((3, count, channels + 4), self.part, dtype=torch.float32)
        for piece in torch.split(flat, count):
            self._normalise(piece, lines[:, : len(piece)])
        return pixels.permute(0, 3, 1, 2)

    def _normalise(self, pixels: Tensor, lines: Tensor) -> None:
        """Normalise (P, C) in place.

        Args:
            pixels: The values.
            lines: Three buffers (3, P, C + 4); the first has ``part`` in two columns at either end.
        """
        wide, channels = pixels.float(), pixels.shape[1]
        torch.addcmul(
            lines.new_tensor(self.part), wide, wide, value=self.scale, out=lines[0, :, 2:-2]
        )
        # Neighbours in memory, across the rows' ends as well: faster, and those are not read.
        squares, pairs, sums = lines.flatten(1)
        torch.add(squares[:-1], squares[1:], out=pairs[:-1])
        factor = torch.add(pairs[:-4], pairs[2:-2], out=sums[:-4])
        factor.add_(squares[4:]).rsqrt_()
        factor.mul_(torch.sqrt(factor, out=pairs[:-4]))
        factors = lines[2, :, :channels]
        if wide is pixels:
            pixels.mul_(factors)
        else:
            pixels.copy_(wide.mul_(factors))
