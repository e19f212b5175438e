"""Time functions in turns, so that a change of the machine's speed affects all alike."""

import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import torch

from tex_lightning.core.devices import synchronise
from tex_lightning.core.progress import track

MIN_ROUNDS = 3


class Timing(NamedTuple):
    """Time of a function in ms: median and 95th percentile of all timed calls, and each of them."""

    median: float
    p95: float
    calls: tuple[float, ...]


def interleaved(
    functions: Mapping[str, Callable[[], object]],
    repeats: int,
    warm_up: int = 1,
    *,
    slice_s: float = 0.0,
    budget_s: float = float("inf"),
) -> dict[str, Timing]:
    """Time functions interleaved: every round calls each of them in order.

    A function that hands work to an accelerator has to wait for it; see :func:`waiting`.

    Args:
        functions: Functions to time, by name; their results are discarded.
        repeats: Number of rounds.
        warm_up: Calls of each function before the first round, not timed.
        slice_s: A function is called again in the same round until it has had this many seconds,
            so that a quick one beside a slow one gets a sample worth its name; 0 calls it once.
        budget_s: No new round begins when the rounds have taken this many seconds, but for the
            first three.
    """
    for function in functions.values():
        for _ in range(warm_up):
            function()
    spent: dict[str, list[float]] = {name: [] for name in functions}
    begin = time.perf_counter()
    for done in track(range(repeats), "timing repeat"):
        if done >= MIN_ROUNDS and time.perf_counter() - begin > budget_s:
            break
        for name, function in functions.items():
            spent[name] += _turn(function, slice_s)
    calls = {name: 1000 * np.array(seconds) for name, seconds in spent.items()}
    return {
        name: Timing(float(np.median(ms)), float(np.percentile(ms, 95)), tuple(ms.tolist()))
        for name, ms in calls.items()
    }


def waiting(function: Callable[[], object], device: torch.device) -> Callable[[], object]:
    """Return the function, waiting for the device before it returns."""
    if device.type == "cpu":
        return function

    def wait() -> None:
        function()
        synchronise(device)

    return wait


def _turn(function: Callable[[], object], slice_s: float) -> list[float]:
    """Return seconds of each call in one turn of a function."""
    times: list[float] = []
    while not times or sum(times) < slice_s:
        begin = time.perf_counter()
        function()
        times.append(time.perf_counter() - begin)
    return times
