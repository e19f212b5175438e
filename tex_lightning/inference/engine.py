"""One place where a trained classifier becomes the one that tests and predicts."""

import logging

import torch
from torch import Tensor, nn

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.inference.rewrite import fold_batch_norm, speed_up_response_norm
from tex_lightning.networks.blocks import Level
from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.visualnet import VisualNet
from tex_lightning.schema import EngineConfig

log = logging.getLogger(__name__)

BFLOAT16 = ("avx512_bf16", "amx_bf16", "bf16")  # what processors call it


def accelerate(classifier: SurfaceClassifier, config: EngineConfig) -> SurfaceClassifier:
    """Copy a classifier for inference, with the switches of ``config``.

    Args:
        classifier: A trained classifier on any device; it is left as it is.
        config: The switches.

    Returns:
        An independent classifier on the same device, in evaluation mode and without gradients.
        Its ``logits`` are float32 and, but for rounding, those of the original.
    """
    return Accelerated(classifier, config)


class Accelerated(SurfaceClassifier):
    """A classifier whose networks were rewritten for speed; see :func:`accelerate`."""

    def __init__(self, classifier: SurfaceClassifier, config: EngineConfig) -> None:
        super().__init__(classifier.card)
        self.load_state_dict(classifier.state_dict())
        device = next(classifier.parameters()).device
        self.to(device).eval().requires_grad_(False)
        for network in (self.haptic_network, self.visual_network):
            if network is not None:
                _rewrite(network, config)
        if config.precision == "bf16":
            _warn_of_slow_bf16(device)

    @property
    def haptic_network(self) -> HapticNet | None:
        """HapticNet, inside FusionNet or by itself."""
        network = self.network.haptic if isinstance(self.network, FusionNet) else self.network
        return network if isinstance(network, HapticNet) else None

    @property
    def visual_network(self) -> VisualNet | None:
        """VisualNet, inside FusionNet or by itself."""
        network = self.network.visual if isinstance(self.network, FusionNet) else self.network
        return network if isinstance(network, VisualNet) else None

    def haptic_input(self, trace: Tensor) -> Tensor:
        """The spectrogram in the precision of the network."""
        return _like(super().haptic_input(trace), self.haptic_network)

    def visual_input(self, photo: Tensor) -> Tensor:
        """The pixels in the precision of the network."""
        return _like(super().visual_input(photo), self.visual_network)

    def haptic_positions(self, trace: Tensor, level: Level) -> Tensor:
        """Features (D, L), float32."""
        return super().haptic_positions(trace, level).float()

    def visual_positions(self, photo: Tensor, level: Level) -> Tensor:
        """Features (D, M, N), float32."""
        return super().visual_positions(photo, level).float()


class Widen(nn.Module):
    """To float32, before the layer of the class scores: bfloat16 would make ties of them."""

    def forward(self, x: Tensor) -> Tensor:
        """Convert without a copy where there is nothing to do."""
        return x.float()


def _rewrite(network: HapticNet | VisualNet, config: EngineConfig) -> None:
    if config.fold_batch_norm:
        fold_batch_norm(network)
    if config.fast_response_norm:
        speed_up_response_norm(network)
    if config.channels_last:
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # no stub
    if config.precision == "bf16":
        scores = network.head.scores
        network.to(torch.bfloat16)
        network.head.scores = nn.Sequential(Widen(), scores.float())
    if config.compile:
        network.trunk.compile(dynamic=True)
        network.head.compile(dynamic=True)


def _like(x: Tensor, network: nn.Module | None) -> Tensor:
    return x if network is None else x.to(next(network.parameters()).dtype)


def has_bf16(device: torch.device) -> bool | None:
    """Whether a device computes in bfloat16; None where PyTorch does not tell of a processor."""
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
