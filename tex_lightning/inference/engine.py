"""Turn a trained classifier into the accelerated one that tests and predicts."""

import logging
import time
from collections.abc import Iterable
from copy import deepcopy
from typing import Any

import torch
from torch import Tensor, nn

from tex_lightning.branches import Branch
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig
from tex_lightning.errors import UserError
from tex_lightning.features.spectrogram import SpectrogramFeatures
from tex_lightning.inference.response_norm import FastResponseNorm
from tex_lightning.inference.rewrite import fold_batch_norm, speed_up_response_norm

log = logging.getLogger(__name__)

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
    for branch in fast.branches.values():
        for features in branch.features.modules():
            if isinstance(features, SpectrogramFeatures):
                features.fast_spectrogram = config.fast_spectrogram and device.type == "cpu"
        _rewrite(branch.network, config)
    fast.to(device)
    if config.precision == "bf16":
        _warn_of_slow_bf16(device)
    if config.compile:
        _compile(fast.branches.values())
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
def _compile(branches: Iterable[Branch]) -> None:
    """Compile for inputs of any size, and run once so that this is not part of a latency."""
    begin = time.perf_counter()
    try:
        for branch in branches:
            for layer in branch.network.modules():
                if isinstance(layer, FastResponseNorm):
                    layer.stay_uncompiled()
            for part in [*branch.network.children()] or [branch.network]:
                part.compile(dynamic=True)
            if branch.declares_geometry:
                branch.dense(_few_positions(branch), "fc3")
    except Exception as error:  # of PyTorch's compiler or of the one it calls, in many ways
        raise UserError(
            f"engine.compile=true: torch.compile failed ({type(error).__name__}); install a "
            "C++ compiler (g++ or clang++) or set engine.compile=false."
        ) from error
    log.info(
        "Compiled in %.1f s; the first recording of another size may take as long.",
        time.perf_counter() - begin,
    )


def _few_positions(branch: Branch) -> Tensor:
    """An input of a few positions, as the weights of the network are."""
    height, width = branch.window_size
    wide = branch.blank(height, 2 * width)
    return wide.to(next(branch.network.parameters()))


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
