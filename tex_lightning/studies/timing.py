"""Time functions interleaved, so that a machine's changing speed is the same for all of them.

Matrix products beside a network tell how near it comes to what the machine can do.
"""

import time
from collections.abc import Callable, Mapping
from functools import partial
from math import prod
from typing import NamedTuple

import numpy as np
import torch

from tex_lightning.core.devices import synchronise
from tex_lightning.core.progress import track


class Timing(NamedTuple):
    """How long a function took, in ms.

    Attributes:
        median: Median of all timed calls.
        p95: Their 95th percentile.
        calls: Of every timed call.
    """

    median: float
    p95: float
    calls: tuple[float, ...]

    @property
    def repeats(self) -> int:
        """Number of timed calls."""
        return len(self.calls)


def interleaved(
    functions: Mapping[str, Callable[[], object]],
    repeats: int,
    warm_up: int = 1,
    *,
    slice_s: float = 0.0,
    budget_s: float = float("inf"),
    least: int = 3,
) -> dict[str, Timing]:
    """Time functions interleaved: every round calls each of them, in the order given.

    A function that hands work to an accelerator has to wait for it; see :func:`waiting`.

    Args:
        functions: What to time, by name; their results are thrown away.
        repeats: Number of rounds.
        warm_up: Calls of each function before the first round, not timed.
        slice_s: A function is called again in the same round until it has had this many seconds,
            so that a quick one beside a slow one gets a sample worth its name; 0 calls it once.
        budget_s: No new round begins when the rounds have taken this many seconds.
        least: Rounds that are run whatever the budget, ``repeats`` permitting.

    Returns:
        Timings by the same names.

    Raises:
        ValueError: If ``repeats`` is not positive.
    """
    if repeats < 1:
        raise ValueError(f"repeats is {repeats}, and a median needs at least one call")
    for function in functions.values():
        for _ in range(warm_up):
            function()
    spent: dict[str, list[float]] = {name: [] for name in functions}
    begin = time.perf_counter()
    for done in track(range(repeats), "Timing"):
        if done >= least and time.perf_counter() - begin > budget_s:
            break
        for name, function in functions.items():
            spent[name] += _turn(function, slice_s)
    return {name: _summary(times) for name, times in spent.items()}


def waiting(function: Callable[[], object], device: torch.device) -> Callable[[], object]:
    """The function, waiting for the device before it returns."""
    if device.type == "cpu":
        return function

    def wait() -> None:
        function()
        synchronise(device)

    return wait


def _turn(function: Callable[[], object], slice_s: float) -> list[float]:
    """Seconds of each call in one turn of a function."""
    times: list[float] = []
    while not times or sum(times) < slice_s:
        begin = time.perf_counter()
        function()
        times.append(time.perf_counter() - begin)
    return times


def _summary(seconds: list[float]) -> Timing:
    calls = np.array(seconds) * 1000
    median, p95 = np.percentile(calls, (50, 95))
    return Timing(float(median), float(p95), tuple(calls.tolist()))


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
