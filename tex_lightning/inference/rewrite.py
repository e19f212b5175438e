"""Layers of a trained network, rewritten in place into faster ones with the same result.

Every rewriting is exact algebra, so that only the rounding of float32 differs.
"""

from collections.abc import Iterator

import torch
from torch import Tensor, nn

from tex_lightning.inference.response_norm import FastResponseNorm


def fold_batch_norm(network: nn.Module) -> None:
    """Make batch normalisation part of the convolution before it, wherever that is exact.

    In HapticNet a maximum lies between the two. It commutes with s * x + b where s > 0, so that a
    layer with a scale that is not positive keeps its normalisation.
    """
    for layers in _sequences(network):
        names = list(layers._modules)
        for place, name in enumerate(names):
            norm = layers[place]
            if not isinstance(norm, nn.BatchNorm2d):
                continue
            pooled = isinstance(layers[place - 1], nn.MaxPool2d)
            before = place - 2 if pooled else place - 1
            conv = layers[before]
            scale, shift = _affine(norm)
            if isinstance(conv, nn.Conv2d) and not (pooled and bool((scale <= 0).any())):
                layers[before] = _scaled(conv, scale, shift)
                setattr(layers, name, nn.Identity())


def speed_up_response_norm(network: nn.Module) -> None:
    """Put :class:`FastResponseNorm` in the place of PyTorch's local response normalisation."""
    for layers in _sequences(network):
        for place, layer in enumerate(layers):
            if isinstance(layer, nn.LocalResponseNorm):
                layers[place] = FastResponseNorm(layer)


def _sequences(network: nn.Module) -> Iterator[nn.Sequential]:
    for module in list(network.modules()):
        if isinstance(module, nn.Sequential):
            yield module


def _affine(norm: nn.BatchNorm2d) -> tuple[Tensor, Tensor]:
    """Scale and shift (channels,) in float64 of a normalisation by running statistics."""
    mean, variance = norm.running_mean, norm.running_var
    if mean is None or variance is None:
        raise ValueError("batch normalisation without running statistics cannot be folded")
    scale = norm.weight.double() / (variance.double() + norm.eps).sqrt()
    return scale, norm.bias.double() - mean.double() * scale


@torch.no_grad()
def _scaled(conv: nn.Conv2d, scale: Tensor, shift: Tensor) -> nn.Conv2d:
    """A convolution that gives ``scale * conv(x) + shift``."""
    bias = shift if conv.bias is None else shift + scale * conv.bias.double()
    conv.weight.copy_(conv.weight.double() * scale[:, None, None, None])
    conv.bias = nn.Parameter(bias.to(conv.weight.dtype), requires_grad=False)
    return conv
