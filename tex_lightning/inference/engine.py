"""Turn a trained classifier into the accelerated one that tests and predicts.

Layers are rewritten by exact algebra, so that only the rounding of float32 differs.
:class:`Costs` counts the multiply-accumulates of a decision before it is made.
"""

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from copy import deepcopy
from functools import lru_cache
from typing import Any

import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig
from tex_lightning.errors import UserError
from tex_lightning.senses.base import Sense
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

PIECE = 1 << 19  # elements; with three float32 buffers of this size the cache is not exceeded


log = logging.getLogger(__name__)


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


BFLOAT16 = ("avx512_bf16", "amx_bf16", "bf16")  # what processors call it


def accelerate(classifier: SurfaceClassifier, config: EngineConfig) -> SurfaceClassifier:
    """Copy a classifier for inference, with the switches of ``config``; a baseline has none.

    Args:
        classifier: A trained classifier on any device; it is left as it is.
        config: The switches.

    Returns:
        An independent classifier on the same device, in evaluation mode and without gradients.

    Raises:
        UserError: If the network is to be compiled and cannot be.
    """
    if classifier.card.baseline:
        return classifier
    device = classifier.device
    # on the CPU: not every device computes in float64
    fast = deepcopy(classifier).cpu().eval().requires_grad_(False)
    fast.tile = config.tile
    for sense in fast.senses.values():
        for features in sense.features.modules():
            if isinstance(features, SpectrogramFeatures):
                features.fast_spectrogram = config.fast_spectrogram and device.type == "cpu"
        _rewrite(sense.network, config)
    fast.to(device)
    if config.precision == "bf16":
        _warn_of_slow_bf16(device)
    if config.compile:
        _compile(fast.senses.values())
    return fast


class Widen(nn.Module):
    """Convert to float32 before the layer of the class scores, among which bfloat16 makes ties."""

    def forward(self, x: Tensor) -> Tensor:
        """Convert without a copy where there is nothing to do."""
        return x.float()


def _rewrite(network: nn.Module, config: EngineConfig) -> None:
    if config.fold_batch_norm:
        fold_batch_norm(network)
    if config.fast_response_norm:
        speed_up_response_norm(network)
    if config.channels_last:
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # no stub
    head: Any = getattr(network, "head", None)  # that the network's class scores end in
    if config.precision == "bf16" and head is not None:
        scores = head.scores
        network.to(torch.bfloat16)
        head.scores = nn.Sequential(Widen(), *scores.float().children())  # its last is score_layer


@torch.inference_mode()
def _compile(senses: Iterable[Sense]) -> None:
    """Compile for inputs of any size, and run once so that this is not part of a latency."""
    begin = time.perf_counter()
    try:
        for sense in senses:
            known = sense.geometry is not None  # which is tried before anything is compiled
            for layer in sense.network.modules():
                if isinstance(layer, FastResponseNorm):
                    layer.stay_uncompiled()
            for part in [*sense.network.children()] or [sense.network]:
                part.compile(dynamic=True)
            if known:
                sense.dense(_few_positions(sense), "fc3")
    except Exception as error:  # of PyTorch's compiler or of the one it calls, in many ways
        raise UserError(
            f"engine.compile=true: torch.compile failed ({type(error).__name__}); install a "
            "C++ compiler (g++ or clang++) or set engine.compile=false."
        ) from error
    log.info(
        "Compiled in %.1f s; the first recording of another size may take as long.",
        time.perf_counter() - begin,
    )


def _few_positions(sense: Sense) -> Tensor:
    """An input of a few positions, as the weights of the network are."""
    height, width = sense.window_size
    wide = sense.blank(height, 2 * width)
    return wide.to(next(sense.network.parameters()))


def has_bf16(device: torch.device) -> bool | None:
    """Whether a device computes in bfloat16; None if PyTorch cannot tell for the processor."""
    if device.type != "cpu":
        return True
    # only newer versions of PyTorch tell
    known: dict[str, object] = getattr(torch.cpu, "get_capabilities", dict)()
    return any(known.get(name) for name in BFLOAT16) if known else None


def _warn_of_slow_bf16(device: torch.device) -> None:
    if has_bf16(device) is False:
        log.warning(
            "engine.precision=bf16: this processor has no bfloat16 arithmetic, so it will be "
            "slower than fp32."
        )


def count_macs(function: Callable[[], object]) -> int:
    """Multiply-accumulates of the convolutions and matrix products that a function runs.

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
        classifier, branch = self.classifier, self.classifier.sense(sense)
        x = branch.blank(height, width).to("meta")
        return count_macs(
            lambda: classifier.project(sense, branch.dense(x, classifier.level(sense)))
        )
