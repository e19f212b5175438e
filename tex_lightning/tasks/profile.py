"""Profile a network beside its sliding-window form: arithmetic and time, in one run."""

import logging
import time
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, EngineConfig, ProfileConfig
from tex_lightning.config.composition import Job
from tex_lightning.core.devices import pick_device
from tex_lightning.core.progress import steps
from tex_lightning.data.decode import Array, SignalDecoder, to_rate
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import RANDOM, environment, write_results
from tex_lightning.inference.engine import accelerate, count_macs
from tex_lightning.learning.loggers import log_profile
from tex_lightning.networks.windows import WindowNet, batches, cut_windows, scores
from tex_lightning.report.profile_table import print_profile
from tex_lightning.senses.base import Sense
from tex_lightning.studies.dataset import configured_card
from tex_lightning.studies.timing import (
    Timing,
    gemm_gflops,
    gflops,
    interleaved,
    products,
    waiting,
)
from tex_lightning.synthetic import make_materials
from tex_lightning.synthetic.camera import render_photo
from tex_lightning.synthetic.specimen import Specimen
from tex_lightning.synthetic.tool import slide_tool

BATCH = 8  # windows that go through a network at once
BATCHES = (8, 32, 128)  # sizes that batched windows are tried in
SLICES = 100  # a quick function gets this fraction of the budget in each round
LEAST_RATE = 2000  # Hz, of a rendered trace: the tool rings at 430 Hz

log = logging.getLogger(__name__)


def run(config: Config, job: Job) -> dict[str, Any]:
    """Measure ``model`` or ``checkpoint``; write ``results.json`` and return it.

    A fusion is measured as the networks that it consists of.
    """
    begin, directory = time.perf_counter(), job.directory
    device = pick_device(config.trainer.accelerator)
    networks: dict[str, Any] = {}
    for classifier in steps(_classifiers(config), lambda each: f"timing {each.card.title}"):
        name = classifier.card.kind
        log.info("Profiling the %s network.", name)
        classifier.eval().to(device)
        recording = _recording(config, classifier)
        networks[name] = compare(classifier, recording, config.engine, config.profile)
        log_profile(config.logger, directory, name, networks[name])
    results = {
        "task": config.task,
        "model": config.model.name,
        "weights": RANDOM if config.checkpoint is None else config.checkpoint,
        "seed": config.seed,
        "wall_seconds": time.perf_counter() - begin,
        "environment": environment(device),
        "engine": asdict(config.engine),
        "networks": networks,
    }
    write_results(directory / "results.json", results)
    print_profile(results, directory)
    return results


def _classifiers(config: Config) -> list[SurfaceClassifier]:
    """The unimodal networks of a checkpoint, or with random weights: no time depends on them.

    Raises:
        UserError: If a recording is given that none of them reads.
    """
    if config.checkpoint is not None:
        whole = SurfaceClassifier.from_checkpoint(config.checkpoint)
        networks = [whole.with_senses([name]) for name in whole.card.sense_names]
    else:
        names = [f"class{number}" for number in range(config.profile.classes)]
        torch.manual_seed(config.seed)
        cards = [configured_card(config, [sense], names) for sense in config.model.senses]
        networks = [SurfaceClassifier(card) for card in cards]
    needed = [_only(network).modality for network in networks]
    for key, value in config.files.items():
        if key not in needed:
            raise UserError(f"{key}={value} is for a network that is not profiled; leave it out.")
        if isinstance(value, list | dict):
            raise UserError(f"task=profile takes one file, not {key}={value}; give {key}=FILE.")
    return networks


def _only(classifier: SurfaceClassifier) -> Sense:
    """The sense of a unimodal classifier."""
    (sense,) = classifier.senses.values()
    return sense


def _recording(config: Config, classifier: SurfaceClassifier) -> Tensor:
    """Read or render a recording; features of an untrained network learn statistics from it.

    Raises:
        UserError: If the recording is too small for a window.
    """
    sense = _only(classifier)
    if (file := config.files.get(sense.modality)) is None:
        decoded = render_recording(sense, config.profile, config.seed)
    else:
        decoder = sense.decoder.assuming(config.data.file_rate)
        decoded = decoder.decode(Path(str(file)).expanduser())[0]
    recording = torch.from_numpy(decoded.copy())
    least, given = sense.window_size, sense.input_size(recording)
    if given[0] < least[0] or given[1] < least[1]:
        raise UserError(
            f"The {sense.what} gives an input of {given[0]}x{given[1]}, height first, and one "
            f"window of the {sense.name} network takes {least[0]}x{least[1]}; give a larger "
            "recording."
        )
    features: Any = sense.features
    if config.checkpoint is None and hasattr(features, "fit"):
        features.fit([features.magnitudes(recording.to(sense.device))])
    return recording


def render_recording(sense: Sense, profile: ProfileConfig, seed: int) -> Array:
    """Render a recording of the synthetic tool or camera."""
    rng = np.random.default_rng(seed)
    specimen = Specimen(make_materials(2, seed)[0])
    if isinstance(sense.decoder, SignalDecoder):
        rate = round(sense.decoder.sampling_rate)
        rendered = max(rate, LEAST_RATE)
        trace = slide_tool(specimen, rng, profile.seconds, rendered)
        return to_rate(trace, rendered, rate, "The rendered trace")
    return render_photo(specimen, rng, size=(profile.width, profile.height))


@torch.inference_mode()
def compare(
    classifier: SurfaceClassifier, recording: Tensor, engine: EngineConfig, profile: ProfileConfig
) -> dict[str, Any]:
    """Measure one network; the keys are those of ``networks.NAME`` in ``results.json``.

    Args:
        classifier: Unimodal, in evaluation mode, as trained.
        recording: Decoded, as its sense takes it.
        engine: How the network is accelerated.
        profile: Budgets.
    """
    sense, fast = _only(classifier), accelerate(classifier, engine)
    network = sense.network
    twin = WindowNet(network).to(memory_format=torch.contiguous_format)  # type: ignore[call-overload]  # no stub
    x = _input(sense, recording).contiguous()
    grid = cut_windows(x, sense.window_size, sense.stride)
    own = _only(fast)
    fast_input = _input(own, recording)
    ways: dict[str, Callable[[], Any]] = {
        "reference": partial(sense.dense_grid, x, "fc3"),
        "sliding_window": partial(_all_windows, twin, grid, 1),
        "same_engine_window": _batched(
            partial(scores, own.network), cut_windows(fast_input, own.window_size, own.stride)
        ),
        "fcn": partial(own.dense_grid, fast_input, "fc3"),
    }
    labels = [ways[name]().argmax(0) for name in ("reference", "fcn")]
    windows = grid.shape[0] * grid.shape[1]
    macs, one = count_macs(lambda: scores(network, x)), count_macs(lambda: twin(grid[0, 0][None]))
    return {
        **_speed(_time(ways, x.device, profile), macs),
        "windows": windows,
        "macs": macs,
        "window_macs": one,
        "arithmetic_ratio": windows * one / macs,
        "parameters": classifier.count_parameters(),
        "label_agreement": agreement(network, twin, grid),
        "flips_engine": int((labels[0] != labels[1]).sum()),
        "input": list(x.shape),
    }


def _input(sense: Sense, recording: Tensor) -> Tensor:
    """Network input (1, C, H, W), in the precision and on the device of the first weights."""
    x = sense(recording)
    found: Tensor = x.to(next(sense.network.parameters(), x))
    return found


def agreement(network: nn.Module, twin: WindowNet, grid: Tensor) -> float:
    """Share of windows that the twin gives the same label as the network on the window alone.

    Args:
        network: As trained.
        twin: Twin of ``network``.
        grid: Windows (rows, columns, C, height, width).
    """
    twins = torch.cat([twin(batch) for batch in batches(grid, BATCH)]).argmax(1)
    parts = [scores(network, batch).flatten(1) for batch in batches(grid, BATCH)]
    return float((twins == torch.cat(parts).argmax(1)).cpu().double().mean())


def _all_windows(function: Callable[[Tensor], Tensor], grid: Tensor, size: int) -> None:
    for batch in batches(grid, size):
        function(batch)


def _batched(function: Callable[[Tensor], Tensor], grid: Tensor) -> Callable[[], None]:
    """All windows in batches of the size with the least time for one, tried on the first."""
    count = grid.shape[0] * grid.shape[1]
    sizes = sorted({min(size, count) for size in BATCHES})
    tried = {str(size): partial(function, next(batches(grid, size))) for size in sizes}
    timings = interleaved(
        {name: waiting(call, grid.device) for name, call in tried.items()}, repeats=2
    )
    best = min(sizes, key=lambda size: timings[str(size)].median / size)
    return partial(_all_windows, function, grid, best)


def _time(
    ways: dict[str, Callable[[], Any]], device: torch.device, profile: ProfileConfig
) -> dict[str, Timing]:
    """Time everything interleaved, matrix products included."""
    functions = {
        name: waiting(function, device) for name, function in {**ways, **products(device)}.items()
    }
    quick = [function for name, function in functions.items() if "window" not in name]
    for function in quick * 2:
        function()
    return interleaved(
        functions,
        profile.rounds,
        warm_up=0,
        slice_s=profile.budget_s / SLICES,
        budget_s=profile.budget_s,
    )


def _speed(timings: dict[str, Timing], macs: int) -> dict[str, Any]:
    """Times and what follows from them; ways are compared that compute alike."""
    shapes = {name: timing for name, timing in timings.items() if name[0].isdigit()}
    ways = {name: timing for name, timing in timings.items() if name not in shapes}
    fcn, reference, rate = ways["fcn"].median, ways["reference"].median, gemm_gflops(shapes)
    return {
        **{f"{name}_ms": timing.median for name, timing in ways.items()},
        **{f"{name}_p95_ms": timing.p95 for name, timing in ways.items()},
        "speedup": ways["sliding_window"].median / reference,
        "speedup_same_engine": ways["same_engine_window"].median / fcn,
        "engine_speedup": reference / fcn,
        "gemm_gflops": rate,
        "roofline_fraction": gflops(macs, fcn) / rate,
    }
