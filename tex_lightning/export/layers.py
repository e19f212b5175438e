"""Layers of a trained network, rewritten so that they can be traced at any size.

Every rewriting is exact algebra. Sizes are known only when the file runs: nothing here branches on
them.
"""

from copy import deepcopy

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, max_pool2d, pad

from tex_lightning.inference.engine import fold_batch_norm

LOWEST = torch.finfo(torch.float32).min


class CeilMaxPool(nn.Module):
    """Max pooling that rounds sizes up, as pooling that rounds down a map with a margin.

    A margin of ``stride - 1`` at the far end gives ``floor((n + s - 1 - k) / s) + 1`` places, which
    is ``ceil((n - k) / s) + 1``. With a stride up to the kernel and no padding the last one begins
    inside the map, so the two rules for windows that begin in padding, of PyTorch and of ONNX,
    never differ.

    Args:
        pool: With ``ceil_mode``, without padding and dilation.
    """

    def __init__(self, pool: nn.MaxPool2d) -> None:
        super().__init__()
        self.kernel, self.stride = pool.kernel_size, pool.stride
        self.margin = int(pool.stride) - 1  # type: ignore[arg-type]  # a number, see `fits`

    @staticmethod
    def fits(layer: nn.Module) -> bool:
        """Whether a layer is such a pooling."""
        if not isinstance(layer, nn.MaxPool2d) or not layer.ceil_mode:
            return False
        square = isinstance(layer.kernel_size, int) and isinstance(layer.stride, int)
        plain = (layer.padding, layer.dilation, layer.return_indices) == (0, 1, False)
        return square and plain and layer.stride <= layer.kernel_size  # type: ignore[operator]

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, C, M, N) to (B, C, M', N')."""
        padded = pad(x, (0, self.margin, 0, self.margin), value=LOWEST)
        return max_pool2d(padded, self.kernel, self.stride)


class BandedResponseNorm(nn.Module):
    """Local response normalisation whose sum over channels is a 1x1 convolution by a band.

    Args:
        layer: PyTorch's, of an odd size.
    """

    def __init__(self, layer: nn.LocalResponseNorm) -> None:
        super().__init__()
        self.reach = layer.size // 2
        self.scale, self.k, self.beta = layer.alpha / layer.size, layer.k, layer.beta

    def forward(self, x: Tensor) -> Tensor:
        """Normalise (B, C, M, N) across C."""
        channel = torch.arange(x.shape[1], device=x.device)
        band = ((channel[:, None] - channel).abs() <= self.reach).to(x.dtype) * self.scale
        return x / (conv2d(x.square(), band[:, :, None, None]) + self.k).pow(self.beta)


def exportable(network: nn.Module) -> nn.Module:
    """Copy a network without batch normalisation and with layers that can be traced."""
    copied = deepcopy(network).cpu().float().eval().requires_grad_(False)
    fold_batch_norm(copied)
    for parent in list(copied.modules()):
        for name, layer in parent.named_children():
            if CeilMaxPool.fits(layer):
                setattr(parent, name, CeilMaxPool(layer))  # type: ignore[arg-type]  # as it fits
            elif isinstance(layer, nn.LocalResponseNorm) and layer.size % 2:
                setattr(parent, name, BandedResponseNorm(layer))
    return copied
