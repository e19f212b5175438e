"""The engine's switches: HapticNet on 20 s, VisualNet on 1632x1224 pixels, both of width 1.

Each switch alone and all of them together, as ratios of the reference's time to theirs, and the
whole forward pass as a share of the rate of matrix products on the same machine. The inputs are
noise and the weights random; neither decides over the time.
"""

import json
import sys
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from omegaconf import OmegaConf
from torch import Tensor, nn

from tex_lightning.card import Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import CONF, EngineConfig
from tex_lightning.data.decode import DecodeSettings
from tex_lightning.data.folds import Kind
from tex_lightning.inference.engine import accelerate
from tex_lightning.inference.macs import count_macs
from tex_lightning.networks.blocks import Norm
from tex_lightning.networks.trunks import TRUNKS
from tex_lightning.profiling.roofline import gemm_gflops, gflops, products
from tex_lightning.profiling.timing import interleaved

OFF = EngineConfig(False, False, False, "fp32", False, None)
DEFAULT = EngineConfig(**dict(OmegaConf.load(CONF / "engine" / "default.yaml")))
CASES: list[tuple[Kind, Norm]] = [
    ("haptic", "batch"),
    ("haptic", "lrn"),
    ("visual", "batch"),
    ("visual", "lrn"),
]
SWITCHES = {
    "fold_batch_norm": replace(OFF, fold_batch_norm=True),
    "fast_response_norm": replace(OFF, fast_response_norm=True),
    "channels_last": replace(OFF, channels_last=True),
    "default": DEFAULT,
    "bf16": replace(DEFAULT, precision="bf16"),
}
REPEATS = 9


def measure(threads: int = 2) -> dict[str, Any]:
    """Ratios of every switch and the share of the matrix rate, by network and normalisation."""
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        with torch.inference_mode():
            return {f"{kind}_{norm}": _case(kind, norm) for kind, norm in CASES}
    finally:
        torch.set_num_threads(before)


def _case(kind: Kind, norm: Norm) -> dict[str, Any]:
    plain = make_classifier(kind, norm)
    x = make_input(kind)
    networks = {"reference": accelerate(plain, OFF).network}
    networks |= {name: accelerate(plain, switch).network for name, switch in SWITCHES.items()}
    inputs = {name: x.to(next(net.parameters()).dtype) for name, net in networks.items()}
    passes = {name: partial(net, inputs[name]) for name, net in networks.items()}
    matrices = products(x.device)
    timings = interleaved({**passes, **matrices}, REPEATS)
    rate = gemm_gflops({name: timings[name] for name in matrices})
    ms = {name: timings[name].median for name in networks}
    reached = gflops(count_macs(partial(plain.network, x)), ms["default"])
    return {
        **{f"{name}_ratio": ms["reference"] / ms[name] for name in SWITCHES},
        "roofline_ratio": reached / rate,
        "gemm_gflops": rate,
        "ms": ms,
    }


def make_input(kind: Kind) -> Tensor:
    """Noise of the size of a spectrogram of 20 s, or of a halved photo of 8 megapixels."""
    if kind == "haptic":
        return torch.randn(1, 1, 50, 1996)
    # decoded photos have the channels innermost
    return torch.randn(1, 3, 1224, 1632).contiguous(memory_format=torch.channels_last)


def make_classifier(
    kind: Kind, norm: Norm, *, width: float = 1.0, trunk: str = "alexnet_caffe"
) -> SurfaceClassifier:
    """A classifier of 16 classes whose scores vary, as a trained one's do."""
    torch.manual_seed(0)
    network = {"width": width, "norm": norm, "dropout": 0.5}
    convolutions = TRUNKS[trunk]
    node = {"_target_": f"{convolutions.__module__}.{convolutions.__name__}"}
    card = Card(
        kind=kind,
        classes=[f"class{number}" for number in range(16)],
        decode=DecodeSettings().to_dict(),
        decision={"pairs": 1000, "seed": 0},
        haptic_features={"normalisation": "standard"} if kind == "haptic" else {},
        haptic_network=network if kind == "haptic" else {},
        visual_network={**network, "trunk": node} if kind == "visual" else {},
    )
    classifier = SurfaceClassifier(card).eval()
    for layer in classifier.network.head.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight)
    return classifier


if __name__ == "__main__":
    print(json.dumps(measure(*map(int, sys.argv[1:])), indent=1))
