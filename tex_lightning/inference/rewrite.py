"""Layers of a trained network, rewritten in place into faster ones with the same result.

Every rewriting is exact algebra, so that only the rounding of float32 differs.
"""

from collections.abc import Iterator
from itertools import pairwise

import torch
from torch import Tensor, nn

from tex_lightning.inference.long_conv import LongConv
from tex_lightning.inference.pooling import FastPool
from tex_lightning.inference.response_norm import FastResponseNorm
from tex_lightning.inference.winograd import Pooled, WinogradConv
from tex_lightning.networks.blocks import is_plain
from tex_lightning.networks.hapticnet import FINAL_KERNEL

# Below it the additions of Winograd's method cost as much as the multiplications that it saves.
MIN_DEPTH = 32


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


def speed_up_convolutions(network: nn.Module) -> None:
    """Put Winograd's in the place of 3x3 convolutions, :class:`LongConv` of 4x12.

    A convolution of few channels stays: there is less to multiply than to add. Pooling by 2x2 is
    part of Winograd's convolution before it, or becomes :class:`FastPool`.
    """
    for layers in _sequences(network):
        for place, (conv, after) in enumerate(pairwise([*layers, None])):
            if not isinstance(conv, nn.Conv2d) or not is_plain(conv):
                continue
            pooled = _is_2x2(after)
            by_winograd = _is_3x3(conv) and _depth(conv) >= MIN_DEPTH
            if by_winograd:
                layers[place] = WinogradConv(conv, pooled=pooled)
            elif (conv.kernel_size, conv.padding, conv.groups) == (FINAL_KERNEL, (0, 0), 1):
                layers[place] = LongConv(conv)
            if pooled:
                layers[place + 1] = Pooled() if by_winograd else FastPool()


def _is_3x3(conv: nn.Conv2d) -> bool:
    return (conv.kernel_size, conv.padding) == ((3, 3), (1, 1))


def _depth(conv: nn.Conv2d) -> float:
    """Multiplications by a tap at one place for each channel there, of inputs and outputs."""
    channels = conv.in_channels + conv.out_channels
    return conv.in_channels * conv.out_channels / conv.groups / channels


def _is_2x2(layer: nn.Module | None) -> bool:
    if not isinstance(layer, nn.MaxPool2d):
        return False
    return (layer.kernel_size, layer.stride, layer.padding, layer.ceil_mode) == (2, 2, 0, True)


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
