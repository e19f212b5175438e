"""Time a network against its sliding-window form and against bare matrix products.

The paper compares its networks with such windows (section IV, "Time profiling").
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from math import prod
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig, ProfileConfig
from tex_lightning.data.decode import Array, SignalDecoder
from tex_lightning.inference.engine import accelerate, count_macs
from tex_lightning.networks.blocks import Head, independent_copy
from tex_lightning.senses.base import Sense
from tex_lightning.studies.timing import Timing, interleaved, waiting
from tex_lightning.synthetic import make_materials
from tex_lightning.synthetic.camera import render_photo
from tex_lightning.synthetic.specimen import Specimen
from tex_lightning.synthetic.tool import slide_tool
from tex_lightning_runtime.resampling import to_rate

BATCH = 32  # windows that go through a network at once
SLICES = 100  # a quick function gets this fraction of the budget in each round
MIN_RATE = 2000  # Hz, of a rendered trace: the tool rings at 430 Hz
# Rows, inner size and columns of products of which one or another is this machine's fastest:
# squares, and the flat shape that convolutions have. A graphics card takes more to be busy.
SHAPES = ((512, 512, 512), (1024, 1024, 1024), (2048, 2048, 2048), (4096, 1152, 128))
LARGE = ((8192, 8192, 8192),)


class WindowNet(nn.Module):
    """A CNN for one window: the network's layers, with its head as fully connected layers.

    FC1 to FC3 become ``nn.Linear`` on the flattened features of the trunk, with the same weights.
    HapticNet's 4x12 convolution stays one, as in the paper's table. A network that is not made of
    a ``trunk`` and a ``head`` is taken as it is.

    Args:
        network: With ``features(x, level)``; it is copied.
    """

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        whole: Any = independent_copy(network)
        self.trunk, self.head = whole, nn.Sequential(nn.Flatten())
        self.connected = hasattr(whole, "trunk") and isinstance(getattr(whole, "head", None), Head)
        if self.connected:
            leaves = [leaf for leaf in whole.head.modules() if not list(leaf.children())]
            self.trunk = whole.trunk
            self.head.extend(map(_connected, leaves))
        self.train(network.training)

    def forward(self, windows: Tensor) -> Tensor:
        """Map windows (B, C, height, width) to class scores before softmax (B, classes)."""
        features = self.trunk(windows) if self.connected else scores(self.trunk, windows)
        class_scores: Tensor = self.head(features)
        return class_scores


def scores(network: Any, x: Tensor) -> Tensor:  # noqa: ANN401
    """Return class scores (B, classes, *positions) of a network's inputs."""
    class_scores: Tensor = network.features(x, "fc3")
    return class_scores


@torch.no_grad()
def _connected(layer: nn.Module) -> nn.Module:
    """Return the layer for flattened features."""
    if isinstance(layer, nn.Conv2d):
        weight = layer.weight.flatten(1)
        linear = nn.Linear(weight.shape[1], len(weight))
        linear.weight, linear.bias = nn.Parameter(weight), layer.bias  # type: ignore[assignment]
        return linear
    if isinstance(layer, nn.BatchNorm2d):
        norm = nn.BatchNorm1d(layer.num_features, layer.eps, layer.momentum)
        norm.load_state_dict(layer.state_dict())
        return norm.to(layer.weight.device)
    return layer


def cut_windows(x: Tensor, size: tuple[int, int], step: int) -> Tensor:
    """Return full windows of an input, as far apart as the predictions of the network.

    Window (i, j) starts where prediction (i, j) of the whole input does. The network's ceil-mode
    pooling adds predictions at the far ends, for which no full window is left.

    Args:
        x: One input (1, C, H, W).
        size: Height and width of a window.
        step: Elements from one to the next, either way.

    Returns:
        A view (rows, columns, C, *size); a spectrogram has one row.
    """
    height, width = size
    return x[0].unfold(1, height, step).unfold(2, width, step).permute(1, 2, 0, 3, 4)


def batches(grid: Tensor, size: int) -> Iterator[Tensor]:
    """Copy windows row by row into batches (B, C, height, width) of at most ``size``."""
    rows, columns = grid.shape[:2]
    places = torch.arange(rows * columns, device=grid.device)
    for begin in range(0, len(places), size):
        chosen = places[begin : begin + size]
        yield grid[chosen // columns, chosen % columns]


def only_sense(classifier: SurfaceClassifier) -> Sense:
    """Return the sense of a unimodal classifier."""
    (sense,) = classifier.senses.values()
    return sense


def render_recording(sense: Sense, profile: ProfileConfig, seed: int) -> Array:
    """Render a recording of the synthetic tool or camera."""
    rng = np.random.default_rng(seed)
    specimen = Specimen(make_materials(2, seed)[0])
    if isinstance(sense.decoder, SignalDecoder):
        rate = round(sense.decoder.sampling_rate)
        rendered = max(rate, MIN_RATE)
        trace = slide_tool(specimen, rng, profile.seconds, rendered)
        return to_rate(trace, rendered, rate, "The rendered trace")
    return render_photo(specimen, rng, size=(profile.width, profile.height))


@torch.inference_mode()
def profile_network(
    classifier: SurfaceClassifier,
    recordings: Sequence[Tensor],
    engine: EngineConfig,
    profile: ProfileConfig,
) -> dict[str, Any]:
    """Measure one network; the keys are those of ``networks.NAME`` in ``results.json``.

    The classifier is unimodal, in evaluation mode, as trained. Of the recordings, decoded as its
    sense takes them, the first one is timed.
    """
    sense, fast = only_sense(classifier), only_sense(accelerate(classifier, engine))
    network = sense.network
    windowed = WindowNet(network).to(memory_format=torch.contiguous_format)  # type: ignore[call-overload]  # no stub
    inputs = [_input(sense, recording).contiguous() for recording in recordings]
    x, fast_x = inputs[0], _input(fast, recordings[0])
    grid = cut_windows(x, sense.window_size, sense.stride)
    fast_grid = cut_windows(fast_x, fast.window_size, fast.stride)
    fast_scores = partial(scores, fast.network)
    ways: dict[str, Callable[[], Any]] = {
        "reference": partial(sense.dense_grid, x, "fc3"),
        "sliding_window": partial(_all_windows, windowed, grid, 1),
        "same_engine_window": partial(_all_windows, fast_scores, fast_grid, BATCH),
        "fcn": partial(fast.dense_grid, fast_x, "fc3"),
    }
    windows = grid.shape[0] * grid.shape[1]
    macs, one = (
        count_macs(lambda: scores(network, x)),
        count_macs(lambda: windowed(grid[0, 0][None])),
    )
    return {
        **_speed(*_time(ways, x.device, profile), macs),
        "windows": windows,
        "macs": macs,
        "arithmetic_ratio": windows * one / macs,
        **agreement(classifier, windowed, inputs),
    }


def _input(sense: Sense, recording: Tensor) -> Tensor:
    """Return the network input (1, C, H, W), in the precision and on the device of the weights."""
    x = sense(recording)
    converted: Tensor = x.to(next(sense.network.parameters(), x))
    return converted


def agreement(
    classifier: SurfaceClassifier, windowed: WindowNet, inputs: Sequence[Tensor]
) -> dict[str, float]:
    """Compare the labels of the dense pass with those of the windows, each classified alone.

    Inside of a recording the layers of the dense pass see what lies beside a window, where those of
    the window see their padding, so that a few labels differ.

    ``windowed`` is the network of the unimodal classifier for one window, inputs are (1, C, H, W).

    Returns:
        ``label_agreement``, the share of all windows with the label of their position in the dense
        pass, and ``recording_agreement``, the share of inputs to which both votes give one label.
    """
    sense, same, votes = only_sense(classifier), [], []
    for x in inputs:
        grid = cut_windows(x, sense.window_size, sense.stride)
        rows, columns = grid.shape[:2]
        alone = torch.cat([windowed(batch).flatten(1) for batch in batches(grid, BATCH)]).T
        dense = sense.dense_grid(x, "fc3")
        same.append(dense[:, :rows, :columns].flatten(1).argmax(0) == alone.argmax(0))
        whole, windows = (
            classifier.decide(logits, classifier.card.temperature)
            for logits in (dense.flatten(1), alone)
        )
        votes.append(whole.label == windows.label)
    return {
        "label_agreement": float(torch.cat(same).cpu().double().mean()),
        "recording_agreement": sum(votes) / len(votes),
    }


def _all_windows(function: Callable[[Tensor], Tensor], grid: Tensor, size: int) -> None:
    for batch in batches(grid, size):
        function(batch)


def products(device: torch.device) -> dict[str, Callable[[], object]]:
    """Return matrix products in fp32 to be timed, by names that :func:`gemm_gflops` reads."""
    functions: dict[str, Callable[[], object]] = {}
    for rows, inner, columns in SHAPES if device.type == "cpu" else SHAPES + LARGE:
        left = torch.randn(rows, inner, device=device)
        right = torch.randn(inner, columns, device=device)
        functions[f"{rows}x{inner}x{columns}"] = partial(torch.mm, left, right)
    return functions


def gemm_gflops(timings: dict[str, Timing]) -> float:
    """Return the rate of the fastest product in GFLOP/s."""
    sizes = {name: prod(map(int, name.split("x"))) for name in timings}
    return max(_gflops(size, timings[name].median) for name, size in sizes.items())


def _gflops(macs: int, milliseconds: float) -> float:
    """Return the GFLOP/s of multiply-accumulates, two operations each, in ``ms``."""
    return 2 * macs / milliseconds / 1e6


def _time(
    ways: dict[str, Callable[[], Any]], device: torch.device, profile: ProfileConfig
) -> tuple[dict[str, Timing], dict[str, Timing]]:
    """Time ways of classifying and matrix products, all interleaved."""
    functions = {
        name: waiting(function, device) for name, function in {**ways, **products(device)}.items()
    }
    for _ in range(2):  # windows need no warm-up: there are many
        for name, function in functions.items():
            if "window" not in name:
                function()
    budget = profile.budget_s
    timings = interleaved(functions, profile.rounds, 0, slice_s=budget / SLICES, budget_s=budget)
    gemm = {name: timings.pop(name) for name in functions if name not in ways}
    return timings, gemm


def _speed(ways: dict[str, Timing], gemm: dict[str, Timing], macs: int) -> dict[str, Any]:
    """Return times and what follows from them; ways are compared that compute alike."""
    fcn, reference, rate = ways["fcn"].median, ways["reference"].median, gemm_gflops(gemm)
    return {
        **{f"{name}_ms": timing.median for name, timing in ways.items()},
        **{f"{name}_p95_ms": timing.p95 for name, timing in ways.items()},
        "speedup": ways["sliding_window"].median / reference,
        "speedup_same_engine": ways["same_engine_window"].median / fcn,
        "engine_speedup": reference / fcn,
        "gemm_gflops": rate,
        "roofline_fraction": _gflops(macs, fcn) / rate,
    }
