"""Rewrite layers by exact algebra so that they run faster.

A pattern is what PyTorch's own classes compute, in an order that an ``nn.Sequential`` fixes. What a
network does with its layers besides no pattern tells: see
:func:`~tex_lightning.inference.engine.rewritten`.
"""

from collections import Counter
from collections.abc import Iterator
from itertools import chain
from typing import Any

import torch
from torch import Tensor, nn

from tex_lightning.core.devices import with_float64
from tex_lightning.networks.blocks import ResponseNorm, SameConv2d

PIECE = 1 << 18  # elements; with two float32 buffers of this size the cache is not exceeded
DENSE = torch.contiguous_format


class FastResponseNorm(nn.Module):
    """``x / (k + alpha / 5 * sum of the squares of 5 channels)^0.75`` across channels.

    PyTorch averages over a padded copy with the channels as a spatial axis, and raises to a power
    with logarithms. Here four shifted additions give the sum and two roots the power, on pieces
    of the image with the channels innermost, which stay in the cache.

    Args:
        layer: PyTorch's layer, one that :meth:`fits`.
        in_place: Whether an input with the channels innermost may be overwritten.
    """

    def __init__(self, layer: nn.LocalResponseNorm, *, in_place: bool = False) -> None:
        super().__init__()
        self.scale, self.k = layer.alpha / layer.size, layer.k
        self.layer, self.in_place = layer, in_place

    @staticmethod
    def fits(layer: Any) -> bool:  # noqa: ANN401
        """Return whether a layer is AlexNet's normalisation."""
        plain = type(layer) in (nn.LocalResponseNorm, ResponseNorm)
        return plain and (layer.size, layer.beta) == (5, 0.75) and not _has_hooks(layer)

    def forward(self, x: Tensor) -> Tensor:
        """Normalise (B, C, H, W) across C; signals (B, C, L) as PyTorch does."""
        if x.dim() != 4:
            normalised: Tensor = self.layer(x)
            return normalised
        pixels = x.permute(0, 2, 3, 1)
        pixels = pixels.contiguous() if self.in_place else pixels.clone(memory_format=DENSE)
        flat = pixels.flatten(0, 2)
        # elsewhere than on a CPU many small pieces cost more than they save
        count = max(1, PIECE // flat.shape[1]) if x.device.type == "cpu" else len(flat)
        for piece in torch.split(flat, count):
            values = piece.float()
            squares = values.square().mul_(self.scale)
            sums = squares + self.k
            for distance in (1, 2):
                sums[:, distance:] += squares[:, :-distance]
                sums[:, :-distance] += squares[:, distance:]
            factor = sums.rsqrt_()
            piece.copy_(values.mul_(factor).mul_(factor.sqrt_()))
        return pixels.permute(0, 3, 1, 2)


def fold_batch_norm(network: nn.Module, source: nn.Module | None = None) -> int:
    """Make batch normalisation part of the convolution before it, wherever that is exact.

    The two stand next to each other in a plain ``nn.Sequential``, are used nowhere else, and the
    normalisation has running statistics of the convolution's channels. In HapticNet a maximum lies
    between the two. It commutes with s * x + b where s > 0, so that a layer with a scale that is
    not positive keeps its normalisation.

    Args:
        network: In evaluation mode; it is changed.
        source: The network whose weights are folded into ``network``, a copy of it that may be
            folded already; None folds its own.

    Returns:
        Number of normalisations that are folded.
    """
    source = network if source is None else source
    uses, folded = _uses(source), 0
    for layers, given in zip(sequences(network), sequences(source), strict=True):
        for place, name in enumerate(list(given._modules)):
            before = _convolution_before(given, place, uses)
            if before is not None:
                _scale(given[before], *_affine(given[place]), layers[before])
                setattr(layers, name, nn.Identity())
                folded += 1
    return folded


def _convolution_before(layers: nn.Sequential, place: int, uses: Counter[int]) -> int | None:
    """Return the place of the convolution that the layer at a place can be folded into, if any."""
    before = place - 2 if place and type(layers[place - 1]) is nn.MaxPool2d else place - 1
    if before < 0 or not _foldable(layers[before], layers[place]):
        return None
    conv, *pools, norm = (layers[index] for index in range(before, place + 1))
    if any(uses[id(part)] > 1 for part in (conv, norm, *conv.parameters(), *norm.parameters())):
        return None
    scale, _ = _affine(norm)
    if any(_has_hooks(pool) or pool.return_indices or (scale <= 0).any() for pool in pools):
        return None
    return before


def _foldable(conv: Any, norm: Any) -> bool:  # noqa: ANN401
    """Return whether a normalisation may be folded into a convolution; both are as PyTorch's."""
    return bool(
        type(norm) is nn.BatchNorm2d
        and norm.running_mean is not None
        and norm.running_var is not None
        and type(conv) in (nn.Conv2d, SameConv2d)  # one with a parametrisation has another type
        and conv.out_channels == norm.num_features
        and not norm.training
        and not _has_hooks(conv)
        and not _has_hooks(norm)
    )


def _has_hooks(layer: nn.Module) -> bool:
    """Return whether something is computed around a layer, as by old forms of weight norm."""
    return bool(layer._forward_hooks or layer._forward_pre_hooks)


def _uses(network: nn.Module) -> Counter[int]:
    """Count the names of every module and parameter of a network."""
    modules = (part for _, part in network.named_modules(remove_duplicate=False))
    parameters = (part for _, part in network.named_parameters(remove_duplicate=False))
    return Counter(map(id, chain(modules, parameters)))


def sequences(network: nn.Module) -> Iterator[nn.Sequential]:
    """Yield the plain sequences of layers in a network."""
    for module in list(network.modules()):
        if isinstance(module, nn.Sequential) and type(module).forward is nn.Sequential.forward:
            yield module


def _affine(norm: Any) -> tuple[Tensor, Tensor]:  # noqa: ANN401
    """Scale and shift (channels,) in float64 of a normalisation by running statistics."""
    scale = (_wide(norm.running_var) + norm.eps).rsqrt()
    if norm.affine:
        scale = _wide(norm.weight) * scale
    shift = -_wide(norm.running_mean) * scale
    return scale, shift + _wide(norm.bias) if norm.affine else shift


def _wide(x: Tensor) -> Tensor:
    """Return a tensor in float64, on the CPU if its device has none."""
    return with_float64(x).double()


@torch.no_grad()
def _scale(conv: Any, scale: Tensor, shift: Tensor, folded: Any) -> None:  # noqa: ANN401
    """Let a convolution like ``conv``, or itself, give ``scale * conv(x) + shift``."""
    bias = shift if conv.bias is None else shift + scale * _wide(conv.bias)
    folded.weight.copy_(_wide(conv.weight) * scale[:, None, None, None])
    folded.bias = nn.Parameter(bias.to(conv.weight), requires_grad=False)
