"""The engine: HapticNet on 20 s, VisualNet on 1632x1224 pixels, both of width 1.

It gives the ratio of the reference's time to the engine's, and the whole forward pass as a share of
the rate of matrix products on the same machine. The inputs are noise and the weights random;
neither decides over the time.
"""

from functools import partial
from typing import Any

import torch
from omegaconf import OmegaConf

from benchmarks._classifiers import make_classifier
from tex_lightning.config import CONF, EngineConfig
from tex_lightning.inference.engine import accelerate, count_macs
from tex_lightning.studies.profile import gemm_gflops, products
from tex_lightning.studies.timing import interleaved

OFF = EngineConfig(**dict(OmegaConf.load(CONF / "engine" / "reference.yaml")))
DEFAULT = EngineConfig(**dict(OmegaConf.load(CONF / "engine" / "default.yaml")))
SIZES = {  # of a spectrogram of 20 s, and of a halved photo of 8 megapixels
    "haptic": (50, 1996),
    "visual": (1224, 1632),
}
NORMS = ("batch", "lrn")
REPEATS = 9


def measure(threads: str = "2") -> dict[str, Any]:
    """Ratios of both times and the share of the matrix rate, by network and normalisation."""
    before = torch.get_num_threads()
    torch.set_num_threads(int(threads))
    try:
        with torch.inference_mode():
            return {f"{kind}_{norm}": _case(kind, norm) for kind in SIZES for norm in NORMS}
    finally:
        torch.set_num_threads(before)


def _case(kind: str, norm: str) -> dict[str, Any]:
    plain = make_classifier(f"model={kind}", f"model.{kind}.width=1", f"model.{kind}.norm={norm}")
    x = torch.randn_like(plain.senses[kind].blank(*SIZES[kind]))
    engines = {"reference": OFF, "default": DEFAULT}
    networks = {name: accelerate(plain, engine).network for name, engine in engines.items()}
    inputs = {name: x.to(next(net.parameters()).dtype) for name, net in networks.items()}
    passes = {name: partial(net, inputs[name]) for name, net in networks.items()}
    matrices = products(x.device)
    timings = interleaved({**passes, **matrices}, REPEATS)
    rate = gemm_gflops({name: timings[name] for name in matrices})
    ms = {name: timings[name].median for name in networks}
    reached = 2 * count_macs(partial(plain.network, x)) / ms["default"] / 1e6
    return {
        "default_ratio": ms["reference"] / ms["default"],
        "roofline_ratio": reached / rate,
        "gemm_gflops": rate,
        "ms": ms,
    }
