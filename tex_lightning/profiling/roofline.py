"""Arithmetic against the clock: how near a network comes to this machine's matrix products."""

from collections.abc import Callable, Mapping
from functools import partial
from math import prod

import torch

from tex_lightning.profiling.timing import Timing

# Rows, inner size and columns of products of which one or another is this machine's fastest:
# squares, and the flat shape that convolutions have. A graphics card takes more to be busy.
SHAPES = ((512, 512, 512), (1024, 1024, 1024), (2048, 2048, 2048), (4096, 1152, 128))
LARGE = ((8192, 8192, 8192),)


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
        gflops(prod(map(int, shape.split("x"))), timing.median) for shape, timing in timings.items()
    )


def gflops(macs: int, milliseconds: float) -> float:
    """GFLOP/s of so many multiply-accumulates in so many ms."""
    return 2 * macs / milliseconds / 1e6
