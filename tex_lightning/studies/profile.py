"""Profile a network beside its sliding-window form: arithmetic, time and memory, in one run."""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import max_vote
from tex_lightning.config import Config, DataConfig, EngineConfig, ProfileConfig
from tex_lightning.config.composition import Job
from tex_lightning.core.devices import pick_device
from tex_lightning.core.progress import steps
from tex_lightning.data.decode import Array, SignalDecoder, to_rate
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import RANDOM, environment, write_results
from tex_lightning.inference.engine import accelerate, count_macs, has_bf16
from tex_lightning.learning.loggers import log_profile
from tex_lightning.networks.windows import WindowNet, batches, cut_windows, dense_grid, scores
from tex_lightning.report.profile_table import print_profile
from tex_lightning.senses.base import Sense
from tex_lightning.studies.dataset import configured_card
from tex_lightning.studies.memory import forward_peak_mib
from tex_lightning.studies.timing import (
    Subject,
    Timing,
    gemm_gflops,
    gflops,
    interleaved,
    only_branch,
    products,
    waiting,
)
from tex_lightning.synthetic import make_materials
from tex_lightning.synthetic.camera import render_photo
from tex_lightning.synthetic.specimen import Specimen
from tex_lightning.synthetic.tool import slide_tool

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
    card, shape = subject.classifier.card, tuple(measured["input"])
    peak = forward_peak_mib(card, engine, shape, subject.classifier.device)
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


LEAST_RATE = 2000  # Hz, of a rendered trace: the tool rings at 430 Hz


def load_networks(checkpoint: str) -> list[SurfaceClassifier]:
    """The unimodal networks of a checkpoint."""
    whole = SurfaceClassifier.from_checkpoint(checkpoint)
    return [whole.with_senses([name]) for name in whole.card.sense_names]


def random_networks(config: Config, classes: int) -> list[SurfaceClassifier]:
    """The unimodal networks of a model with random weights: no time depends on them."""
    names = [f"class{number}" for number in range(classes)]
    torch.manual_seed(config.seed)
    cards = [configured_card(config, [sense], names) for sense in config.model.senses]
    return [SurfaceClassifier(card) for card in cards]


def refuse_unused(files: Mapping[str, Any], networks: Sequence[SurfaceClassifier]) -> None:
    """Refuse recordings that no network reads.

    Raises:
        UserError: Naming one.
    """
    needed = [only_branch(network).modality for network in networks]
    for key, value in files.items():
        if key not in needed:
            raise UserError(f"{key}={value} is for a network that is not profiled; leave it out.")
        if isinstance(value, list | dict):
            raise UserError(f"task=profile takes one file, not {key}={value}; give {key}=FILE.")


def make_subject(classifier: SurfaceClassifier, recording: Array) -> Subject:
    """A network with a recording to classify.

    Raises:
        UserError: If the recording is too small for a window.
    """
    sense, tensor = only_branch(classifier), torch.from_numpy(recording.copy())
    least, given = sense.window_size, sense.input_size(tensor)
    if given[0] < least[0] or given[1] < least[1]:
        raise UserError(
            f"The {sense.what} gives an input of {given[0]}x{given[1]}, height first, and one "
            f"window of the {sense.name} network takes {least[0]}x{least[1]}; give a larger "
            "recording."
        )
    return Subject(classifier, tensor)


def learn_statistics(subject: Subject) -> None:
    """Let untrained features take their statistics from the recording."""
    sense = only_branch(subject.classifier)
    features: Any = sense.features
    if hasattr(features, "fit"):
        features.fit([features.magnitudes(subject.recording.to(sense.device))])


def read_recording(sense: Sense, file: str, data: DataConfig) -> Array:
    """Decode the file that was given."""
    decoder = sense.decoder.assuming(data.file_rate)
    return decoder.decode(Path(file).expanduser())[0]


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


log = logging.getLogger(__name__)


def profile_networks(config: Config, job: Job) -> dict[str, Any]:
    """Measure ``model`` or ``checkpoint``; write ``results.json`` and return it.

    A fusion is measured as the networks that it consists of.
    """
    begin, directory = time.perf_counter(), job.directory
    device = pick_device(config.trainer.accelerator)
    subjects = _subjects(config, device)
    networks: dict[str, Any] = {}
    for subject in steps(subjects, lambda each: f"timing {each.classifier.card.title}"):
        name = subject.classifier.card.kind
        log.info("Profiling the %s network.", name)
        networks[name] = compare(subject, config.engine, config.profile)
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


def _subjects(config: Config, device: torch.device) -> list[Subject]:
    """Load or build the networks, and read or render a recording for each."""
    fresh = config.checkpoint is None
    networks = (
        random_networks(config, config.profile.classes)
        if config.checkpoint is None
        else load_networks(config.checkpoint)
    )
    refuse_unused(config.files, networks)
    subjects = []
    for network in networks:
        sense = only_branch(network.eval().to(device))
        if (file := config.files.get(sense.modality)) is None:
            recording = render_recording(sense, config.profile, config.seed)
        else:
            recording = read_recording(sense, str(file), config.data)
        subjects.append(make_subject(network, recording))
        if fresh:
            learn_statistics(subjects[-1])
    return subjects
