"""One place where a trained classifier becomes the one that tests and predicts."""

import logging
import time
from typing import cast

import torch
from torch import Tensor, nn

from tex_lightning.classifier import SurfaceClassifier, check_side
from tex_lightning.config import EngineConfig
from tex_lightning.errors import UserError
from tex_lightning.features.image import ImageFeatures
from tex_lightning.inference.rewrite import fold_batch_norm, speed_up_response_norm
from tex_lightning.inference.tiles import in_tiles, layer_windows
from tex_lightning.networks.blocks import Level, Window
from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.visualnet import VisualNet

log = logging.getLogger(__name__)

BFLOAT16 = ("avx512_bf16", "amx_bf16", "bf16")  # what processors call it


def accelerate(classifier: SurfaceClassifier, config: EngineConfig) -> SurfaceClassifier:
    """Copy a classifier for inference, with the switches of ``config``; a baseline has none.

    Args:
        classifier: A trained classifier on any device; it is left as it is.
        config: The switches.

    Returns:
        An independent classifier on the same device, in evaluation mode and without gradients.
        Its ``logits`` are float32 and, but for rounding, those of the original.

    Raises:
        UserError: If the network is to be compiled and cannot be.
    """
    if classifier.card.baseline:
        return classifier
    return Accelerated(classifier, config)


class Accelerated(SurfaceClassifier):
    """A classifier whose networks were rewritten for speed; see :func:`accelerate`."""

    def __init__(self, classifier: SurfaceClassifier, config: EngineConfig) -> None:
        super().__init__(classifier.card)
        self.tile = config.tile
        self.load_state_dict(classifier.state_dict())
        device = next(classifier.parameters()).device
        self.eval().requires_grad_(False)
        for network in (self.haptic_network, self.visual_network):
            if network is not None:
                # on the CPU: not every device computes in float64
                _rewrite(network, config)
        self.to(device)
        if config.precision == "bf16":
            _warn_of_slow_bf16(device)
        if config.compile:
            self._compile(device)

    @torch.inference_mode()
    def _compile(self, device: torch.device) -> None:
        """Compile for inputs of any size, and run once so that this is not part of a latency."""
        begin = time.perf_counter()
        try:
            for network in (self.haptic_network, self.visual_network):
                if network is not None:
                    network.trunk.compile(dynamic=True)
                    network.head.compile(dynamic=True)
                    network(_like(_blank(network), network).to(device))
        except Exception as error:  # of PyTorch's compiler or of the one it calls, in many ways
            raise UserError(
                f"engine.compile=true: torch.compile failed ({type(error).__name__}); install a "
                "C++ compiler (g++ or clang++) or set engine.compile=false."
            ) from error
        log.info(
            "Compiled in %.1f s; the first recording of another size may take as long.",
            time.perf_counter() - begin,
        )

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

    def haptic_positions(self, trace: Tensor, level: Level) -> Tensor:
        """Features (D, L), float32."""
        network = cast(HapticNet, self.haptic_network)

        def features(spectrogram: Tensor) -> Tensor:
            return network.features(_like(spectrogram, network), level)[:, :, None].float()

        return in_tiles(features, self.haptic_input(trace), _windows(network), self.tile)[0, :, 0]

    def visual_positions(self, photo: Tensor, level: Level) -> Tensor:
        """Features (D, M, N), float32; a large photo is normalised piece by piece."""
        network = cast(VisualNet, self.visual_network)
        normalise = cast(ImageFeatures, self.image_features)
        check_side(photo.shape[0], photo.shape[1], self.min_side)
        pixels = photo.permute(2, 0, 1)[None]

        def features(pixels: Tensor) -> Tensor:
            pixels = normalise(pixels.to(normalise.mean.device))
            return network.features(_like(pixels, network), level).float()

        return in_tiles(features, pixels, _windows(network), self.tile)[0]


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


def _blank(network: HapticNet | VisualNet) -> Tensor:
    """An input of a few positions."""
    if isinstance(network, HapticNet):
        return torch.zeros(1, 1, network.bands, 2 * network.window)
    sides = network.min_side + 3 * network.stride, network.min_side + 5 * network.stride
    blank = torch.zeros(1, 3, *sides)
    return blank.contiguous(memory_format=torch.channels_last)  # as decoded photos are


def _like(x: Tensor, network: nn.Module) -> Tensor:
    return x.to(next(network.parameters()).dtype)


def _windows(network: nn.Module) -> tuple[list[Window], list[Window]]:
    return layer_windows(network, 0), layer_windows(network, 1)


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
