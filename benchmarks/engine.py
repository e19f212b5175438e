"""The engine: HapticNet on 20 s, VisualNet on 1632x1224 pixels, both of width 1.

It gives the ratio of the reference's time to the engine's, and the whole forward pass as a share of
the rate of matrix products on the same machine, and of the lower of arithmetic and memory for each
layer: a convolution of one channel to many has to write more than it computes. The inputs are noise
and the weights random; neither decides over the time.
"""

from functools import partial
from typing import Any

import torch
from omegaconf import OmegaConf
from torch import nn

from benchmarks._classifiers import make_classifier
from tex_lightning.config import CONF, EngineConfig
from tex_lightning.core.devices import keep_memory
from tex_lightning.inference.engine import accelerate
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
COPIED = 1 << 26  # floats, far more than a cache holds


def measure(threads: str = "2") -> dict[str, Any]:
    """Ratios of both times and the share of the matrix rate, by network and normalisation."""
    before = torch.get_num_threads()
    torch.set_num_threads(int(threads))
    keep_memory()  # as every command does
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
    matrices, source = products(x.device), torch.ones(COPIED)
    copy = {"copy": partial(torch.empty_like(source).copy_, source)}
    timings = interleaved({**passes, **matrices, **copy}, REPEATS)
    rate = gemm_gflops({name: timings[name] for name in matrices})
    memory = 2 * source.nbytes / timings["copy"].median / 1e6
    ms = {name: timings[name].median for name in networks}
    layers = costs(plain.network, x)
    arithmetic = [2 * macs / rate / 1e6 for macs, _ in layers]
    least = [max(ms, size / memory / 1e6) for ms, (_, size) in zip(arithmetic, layers, strict=True)]
    return {
        "default_ratio": ms["reference"] / ms["default"],
        "arithmetic_ratio": sum(arithmetic) / ms["default"],
        "roofline_ratio": sum(least) / ms["default"],
        "gemm_gflops": rate,
        "copied_gb_per_s": memory,
        "ms": ms,
    }


def costs(network: nn.Module, x: torch.Tensor) -> list[tuple[int, int]]:
    """Return multiply-accumulates, and bytes in fp32 that pass, of each convolution.

    What comes between two of them can be computed while their values are in the cache.
    """
    found = []

    def note(layer: nn.Module, inputs: tuple[torch.Tensor, ...], output: torch.Tensor) -> None:
        values = [*inputs, output, *layer.parameters()]
        macs = output.numel() * next(layer.parameters())[0].numel()
        found.append((macs, sum(value.nbytes for value in values)))

    layers = [layer for layer in network.modules() if isinstance(layer, nn.Conv2d)]
    hooks = [layer.register_forward_hook(note) for layer in layers]
    with torch.inference_mode():
        network(x)
    for hook in hooks:
        hook.remove()
    return found
