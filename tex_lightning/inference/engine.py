"""Turn a trained classifier into the accelerated one that tests and predicts.

Layers are rewritten by exact algebra, so that only the rounding of float32 differs.
:class:`Costs` counts the multiply-accumulates of a decision before it is made.
"""

from collections.abc import Callable, Iterator
from copy import deepcopy
from functools import lru_cache

import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

PIECE = 1 << 18  # elements; with two float32 buffers of this size the cache is not exceeded


class FastResponseNorm(nn.Module):
    """``x / (k + alpha / 5 * sum of the squares of 5 channels)^0.75`` across channels.

    PyTorch averages over a padded copy with the channels as a spatial axis, and raises to a power
    with logarithms. Here four shifted additions give the sum and two roots the power, on pieces
    of the image with the channels innermost, which stay in the cache.

    Args:
        layer: PyTorch's layer, of size 5 and beta 0.75 as in AlexNet.
    """

    def __init__(self, layer: nn.LocalResponseNorm) -> None:
        super().__init__()
        if layer.size != 5 or layer.beta != 0.75:
            raise ValueError(f"size {layer.size} and beta {layer.beta} are not those of AlexNet")
        self.scale, self.k = layer.alpha / layer.size, layer.k

    def forward(self, x: Tensor) -> Tensor:
        """Normalise (B, C, H, W) across C, in place where the channels are innermost."""
        pixels = x.permute(0, 2, 3, 1).contiguous()
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
    """Return a convolution that gives ``scale * conv(x) + shift``."""
    bias = shift if conv.bias is None else shift + scale * conv.bias.double()
    conv.weight.copy_(conv.weight.double() * scale[:, None, None, None])
    conv.bias = nn.Parameter(bias.to(conv.weight.dtype), requires_grad=False)
    return conv


def accelerate(classifier: SurfaceClassifier, config: EngineConfig) -> SurfaceClassifier:
    """Copy a classifier for inference as ``config`` says; a baseline stays as it is.

    Args:
        classifier: A trained classifier on any device; it is left as it is.
        config: Whether layers are rewritten, and the size of tiles.

    Returns:
        An independent classifier on the same device, in evaluation mode and without gradients.
    """
    if classifier.card.baseline:
        return classifier
    device = classifier.device
    # on the CPU: not every device computes in float64
    fast = deepcopy(classifier).cpu().eval().requires_grad_(False)
    for sense in fast.senses.values():
        sense.tile = config.tile
        for features in sense.features.modules():
            if isinstance(features, SpectrogramFeatures):
                features.fast_spectrogram = config.fast and device.type == "cpu"
        if config.fast:
            _rewrite(sense.network)
    fast.to(device)
    return fast


def _rewrite(network: nn.Module) -> None:
    fold_batch_norm(network)
    for layers in _sequences(network):
        for place, layer in enumerate(layers):
            if isinstance(layer, nn.LocalResponseNorm):
                layers[place] = FastResponseNorm(layer)
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # no stub


def count_macs(function: Callable[[], object]) -> int:
    """Count the multiply-accumulates of the convolutions and matrix products that a function runs.

    PyTorch counts two operations for each; normalisation, pooling and Fourier transforms are not
    counted.
    """
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        function()
    return int(counter.get_total_flops()) // 2


class Costs:
    """Multiply-accumulates of a card's network, counted on tensors that hold nothing.

    Convolutions and matrix products are counted; features, pooling and normalisation are not.

    Args:
        card: Card of one of this package's networks.

    Attributes:
        of: Multiply-accumulates of one sense with its part of a fusion layer, by its name and the
            height and width of its input.
    """

    def __init__(self, card: Card) -> None:
        self.classifier = SurfaceClassifier(card).eval().to("meta")
        self.of = lru_cache(self._of)

    def _of(self, sense: str, height: int, width: int) -> int:
        classifier, branch = self.classifier, self.classifier.senses[sense]
        x = branch.blank(height, width).to("meta")
        return count_macs(
            lambda: classifier.project(
                sense, branch.dense_grid(x, classifier.level(sense)).flatten(1)
            )
        )
