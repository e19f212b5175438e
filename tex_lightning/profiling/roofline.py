"""Arithmetic against the clock: how near a network comes to this machine's matrix products."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from tex_lightning.devices import synchronise
from tex_lightning.profiling.timing import Timing

# Rows, inner size and columns of products of which one or another is this machine's fastest:
# squares, and the flat shape that convolutions have. A graphics card takes more to be busy.
SHAPES = ((512, 512, 512), (1024, 1024, 1024), (2048, 2048, 2048), (4096, 1152, 128))
LARGE = ((8192, 8192, 8192),)

SILENT = (nn.Identity, nn.Dropout)  # nothing happens there in evaluation mode


def products(device: torch.device) -> dict[str, Callable[[], object]]:
    """Matrix products in fp32 to be timed, by a name that :func:`gemm_gflops` understands."""
    functions: dict[str, Callable[[], object]] = {}
    for rows, inner, columns in SHAPES if device.type == "cpu" else SHAPES + LARGE:
        left = torch.randn(rows, inner, device=device)
        right = torch.randn(inner, columns, device=device)
        functions[f"{rows}x{inner}x{columns}"] = partial(torch.mm, left, right)
    return functions


def gemm_gflops(timings: Mapping[str, Timing]) -> float:
    """Rate of the fastest product in GFLOP/s, two operations for each multiply-accumulate."""
    return max(
        gflops(int(np.prod([int(side) for side in shape.split("x")])), timing.median)
        for shape, timing in timings.items()
    )


def gflops(macs: int, milliseconds: float) -> float:
    """GFLOP/s of so many multiply-accumulates in so many ms."""
    return 2 * macs / milliseconds / 1e6


@dataclass(frozen=True)
class Layer:
    """Cost of one layer inside a network.

    Attributes:
        name: Dotted name of the module.
        kind: Its class.
        ms: Median time.
        macs: Multiply-accumulates of the network as it was trained.
        gflops: Rate that follows.
        roofline_fraction: Share of the rate of matrix products.
    """

    name: str
    kind: str
    ms: float
    macs: int
    gflops: float
    roofline_fraction: float


@dataclass(frozen=True)
class Pass:
    """A network, and one pass of it over an input of its own precision."""

    network: nn.Module
    run: Callable[[], Tensor]


def layers(fast: Pass, original: Pass, rate: float, repeats: int) -> list[Layer]:
    """Time every layer of a network apart, in a pass of their own that hooks slow down a little.

    Args:
        fast: Of the network that is timed, not compiled.
        original: Of the network as it was trained; its multiply-accumulates are counted.
        rate: Rate of matrix products, in GFLOP/s.
        repeats: Timed passes.
    """
    macs = _layer_macs(original)
    found = []
    for name, ms in _layer_times(fast, repeats).items():
        layer = fast.network.get_submodule(name)
        total = sum(count for key, count in macs.items() if f"{key}.".startswith(f"{name}."))
        speed = gflops(total, ms)
        found.append(Layer(name, type(layer).__name__, ms, total, speed, speed / rate))
    return found


def _layer_macs(counted: Pass) -> dict[str, int]:
    """Multiply-accumulates of every leaf module, by name."""
    totals: dict[str, int] = {}
    with FlopCounterMode(display=False) as counter, torch.no_grad():

        def before(name: str, *_: Any) -> None:  # noqa: ANN401
            totals[name] = counter.get_total_flops()

        def after(name: str, *_: Any) -> None:  # noqa: ANN401
            totals[name] = (counter.get_total_flops() - totals[name]) // 2

        _with_hooks(counted.network, before, after, counted.run)
    return totals


def _layer_times(timed: Pass, repeats: int) -> dict[str, float]:
    """Median ms of every leaf module, by name, after one pass that does not count."""
    begun: dict[str, float] = {}
    times: dict[str, list[float]] = {}
    device = next(timed.network.parameters(), torch.empty(0)).device

    def before(name: str, *_: Any) -> None:  # noqa: ANN401
        synchronise(device)
        begun[name] = perf_counter()

    def after(name: str, *_: Any) -> None:  # noqa: ANN401
        synchronise(device)
        times.setdefault(name, []).append(perf_counter() - begun[name])

    def passes() -> None:
        for _ in range(repeats + 1):
            timed.run()

    with torch.inference_mode():
        _with_hooks(timed.network, before, after, passes)
    return {name: float(np.median(spent[1:])) * 1000 for name, spent in times.items()}


def _with_hooks(
    network: nn.Module,
    before: Callable[..., None],
    after: Callable[..., None],
    function: Callable[[], object],
) -> None:
    handles = []
    for name, module in network.named_modules():
        if not list(module.children()) and not isinstance(module, SILENT):
            handles.append(module.register_forward_pre_hook(partial(before, name)))
            handles.append(module.register_forward_hook(partial(after, name)))
    try:
        function()
    finally:
        for handle in handles:
            handle.remove()
