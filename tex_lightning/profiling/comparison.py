"""One network against its sliding-window twin: arithmetic, time and memory, in one run."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from torch import Tensor, nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig, ProfileConfig
from tex_lightning.decision.voting import max_vote
from tex_lightning.inference.costs import count_macs
from tex_lightning.inference.engine import accelerate, has_bf16
from tex_lightning.networks.windows import WindowNet, batches, cut_windows, dense_grid, scores
from tex_lightning.profiling.memory import forward_peak_mib
from tex_lightning.profiling.roofline import gemm_gflops, gflops, products
from tex_lightning.profiling.timing import Subject, Timing, interleaved, only_branch, waiting

BATCH = 8  # windows that go through a network at once


def agreement(network: nn.Module, twin: WindowNet, x: Tensor, grid: Tensor) -> dict[str, float]:
    """Shares of windows that the twin gives the same label as the network does.

    Args:
        network: As trained.
        twin: Twin of ``network``.
        x: Input (1, C, H, W).
        grid: Its windows (rows, columns, C, height, width).

    Returns:
        ``label_agreement``, with the network on the window alone, and ``dense_agreement``, with
        its output for the whole input: there its layers see the neighbourhood of the window where
        the window's own pad with zeros.
    """
    twins = torch.cat([twin(batch) for batch in batches(grid, BATCH)]).argmax(1)
    parts = [scores(network, batch).flatten(1) for batch in batches(grid, BATCH)]
    alone = torch.cat(parts).argmax(1)
    dense = dense_grid(scores(network, x)).argmax(-1)[: grid.shape[0], : grid.shape[1]].flatten()
    return {
        "label_agreement": float((twins == alone).cpu().double().mean()),
        "dense_agreement": float((twins == dense).cpu().double().mean()),
    }


def flips(exact: Tensor, rough: Tensor, name: str) -> dict[str, Any]:
    """Labels that other arithmetic changes.

    Args:
        exact: Scores (classes, positions) of the network as trained, for one input.
        rough: The same, computed in another way.
        name: Name of that way, for the keys.

    Returns:
        ``flips_NAME`` of ``positions``, and ``vote_flips_NAME``, whether the vote changes.
    """
    votes = [max_vote(exact), max_vote(rough)]
    return {
        "positions": len(votes[0].fragments),
        f"flips_{name}": int((votes[0].fragments != votes[1].fragments).sum()),
        f"vote_flips_{name}": votes[0].label != votes[1].label,
    }


BATCHES = (8, 32, 128)  # sizes that batched windows are tried in
SLICES = 100  # a quick function gets this fraction of the budget in each round


def compare(subject: Subject, engine: EngineConfig, profile: ProfileConfig) -> dict[str, Any]:
    """Measure one network; the keys are those of ``networks.NAME`` in ``results.json``.

    Args:
        subject: The network and its recording.
        engine: How the network is accelerated.
        profile: Budgets.
    """
    measured = _measure(subject, engine, profile)
    plain = replace(engine, compile=False)
    card, shape = subject.classifier.card, tuple(measured["input"])
    peak = forward_peak_mib(card, plain, shape, subject.classifier.device)
    return {**measured, "peak_memory_mib": peak}


@torch.inference_mode()
def _measure(subject: Subject, engine: EngineConfig, profile: ProfileConfig) -> dict[str, Any]:
    network = subject.sense.network
    twin = WindowNet(network).to(memory_format=torch.contiguous_format)  # type: ignore[call-overload]  # no stub
    x = subject.features(subject.classifier).contiguous()
    grid = _grid(subject, x)
    ways, sizes = _ways(subject, accelerate(subject.classifier, engine), twin, x, grid)
    exact = ways["reference"]()
    facts = {
        **_arithmetic(subject, twin, x, grid),
        **agreement(network, twin, x, grid),
        **flips(exact, ways["fcn"](), "engine"),
    }
    if (bf16 := _half(subject, engine)) is not None:
        ways["fcn_bf16"] = _dense(subject, bf16)
        facts |= flips(exact, ways["fcn_bf16"](), "bf16")
    speed = _speed(_time(ways, x.device, profile), facts)
    return {**speed, **facts, "batches": sizes, "input": list(x.shape)}


def _grid(subject: Subject, x: Tensor) -> Tensor:
    """The windows of a network input."""
    return cut_windows(x, subject.sense.window_size, subject.sense.stride)


def _dense(subject: Subject, classifier: SurfaceClassifier) -> Callable[[], Tensor]:
    """The way over the whole input, in pieces where the classifier divides it."""
    return partial(only_branch(classifier).dense, subject.features(classifier), "fc3")


def _arithmetic(subject: Subject, twin: WindowNet, x: Tensor, grid: Tensor) -> dict[str, Any]:
    """Multiply-accumulates of both ways."""
    windows = grid.shape[0] * grid.shape[1]
    dense = count_macs(lambda: scores(subject.sense.network, x))
    one = count_macs(lambda: twin(grid[0, 0][None]))
    return {
        "windows": windows,
        "macs": dense,
        "window_macs": one,
        "arithmetic_ratio": windows * one / dense,
        "parameters": subject.classifier.count_parameters(),
    }


def _ways(
    subject: Subject, fast: SurfaceClassifier, twin: WindowNet, x: Tensor, grid: Tensor
) -> tuple[dict[str, Callable[[], Any]], dict[str, int]]:
    """What is timed, by the name of its key, and the batch sizes chosen for windows."""
    own = _grid(subject, subject.features(fast))
    engine = partial(scores, only_branch(fast).network)
    plain, same = _best_batch(twin, grid), _best_batch(engine, own)

    def one_by_one() -> None:
        for row in grid:
            for window in row:
                twin(window[None])

    ways: dict[str, Callable[[], Any]] = {
        "reference": partial(subject.sense.dense, x, "fc3"),
        "features": partial(subject.features, fast),
        "sliding_window": one_by_one,
        "batched_window": partial(_all_windows, twin, grid, plain),
        "same_engine_window": partial(_all_windows, engine, own, same),
        "fcn": _dense(subject, fast),
    }
    return ways, {"batched_window": plain, "same_engine_window": same}


def _all_windows(function: Callable[[Tensor], Tensor], grid: Tensor, size: int) -> None:
    for batch in batches(grid, size):
        function(batch)


def _best_batch(function: Callable[[Tensor], Tensor], grid: Tensor) -> int:
    """The batch size with the least time for a window, tried on the first windows."""
    count = grid.shape[0] * grid.shape[1]
    sizes = sorted({min(size, count) for size in BATCHES})
    tried = {size: next(batches(grid, size)) for size in sizes}
    timings = interleaved(
        {
            str(size): waiting(partial(function, batch), grid.device)
            for size, batch in tried.items()
        },
        repeats=2,
    )
    return min(sizes, key=lambda size: timings[str(size)].median / size)


def _time(
    ways: dict[str, Callable[[], Any]], device: torch.device, profile: ProfileConfig
) -> dict[str, Timing]:
    """Time everything interleaved, matrix products included."""
    functions = {
        name: waiting(function, device) for name, function in {**ways, **products(device)}.items()
    }
    quick = {name: function for name, function in functions.items() if "window" not in name}
    for function in [*quick.values()] * 2:  # windows have been warmed by the choice of the batch
        function()
    return interleaved(
        functions,
        profile.rounds,
        warm_up=0,
        slice_s=profile.budget_s / SLICES,
        budget_s=profile.budget_s,
    )


def _speed(timings: dict[str, Timing], facts: dict[str, Any]) -> dict[str, Any]:
    """Times and what follows from them; ways are compared that compute alike."""
    shapes = {name: timing for name, timing in timings.items() if name[0].isdigit()}
    ways = {name: timing for name, timing in timings.items() if name not in shapes}
    fcn = ways["fcn"].median
    rate = gemm_gflops(shapes)
    return {
        **{f"{name}_ms": timing.median for name, timing in ways.items()},
        **{f"{name}_p95_ms": timing.p95 for name, timing in ways.items()},
        "repeats": {name: timing.repeats for name, timing in ways.items()},
        "speedup": ways["sliding_window"].median / ways["reference"].median,
        "speedup_same_engine": ways["same_engine_window"].median / fcn,
        "engine_speedup": ways["reference"].median / fcn,
        "gemm_gflops": rate,
        "roofline_fraction": gflops(facts["macs"], fcn) / rate,
    }


def _half(subject: Subject, engine: EngineConfig) -> SurfaceClassifier | None:
    """The engine at bf16, where the device computes in it and it is not what runs anyway."""
    if engine.precision == "bf16" or not has_bf16(subject.classifier.device):
        return None
    return accelerate(subject.classifier, replace(engine, precision="bf16"))
