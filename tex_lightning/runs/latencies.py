"""Latencies of the systems of a family, all measured in one run."""

import itertools
import logging
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from math import ceil
from pathlib import Path
from statistics import fmean, median
from typing import NamedTuple

from torch import Tensor

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.core.devices import pick_device
from tex_lightning.data.decode import Decoder
from tex_lightning.data.folds import make_samples
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import load_sample
from tex_lightning.inference.early_stopping import make_inference_model
from tex_lightning.profiling.timing import interleaved, waiting
from tex_lightning.runs.family import Measured
from tex_lightning.runs.opening import Opening
from tex_lightning.runs.workspace import Workspace, open_workspace

log = logging.getLogger(__name__)

WARM_UP = 3
TIMED = 15  # tested samples, at most, that every system is timed on


class Latency(NamedTuple):
    """Time of one sample in ms.

    Attributes:
        mean: Over the samples: that of a sequential decision is short for some and long for others.
        median: Median of all calls.
        p95: Their 95th percentile.
    """

    mean: float
    median: float
    p95: float


Timings = dict[str, Latency]


def measure_latencies(measured: Sequence[Measured], rounds: int, opening: Opening) -> Timings:
    """Times of one sample, all systems interleaved in one run.

    The samples are of the first tested fold: of those that a network was trained on it is surer,
    and a sequential decision quicker, than it will be.

    Args:
        measured: The systems.
        rounds: In each every system classifies one sample.
        opening: Says what was found.
    """
    functions: dict[str, Callable[[], object]] = {}
    counts: dict[str, int] = {}
    recordings: dict[tuple[tuple[str, Decoder], ...], list[dict[str, Tensor]]] = {}
    for system in measured:
        member, config = system.member, system.member.config
        device = pick_device(config.trainer.accelerator)
        trained = load_classifier(system.entry["checkpoint"]).to(device)
        classifier = make_inference_model(trained, config.engine, config.decision)
        decoded = tuple((each.modality, each.decoder) for each in trained.senses.values())
        if decoded not in recordings:  # such systems classify the same samples
            home = Path(system.entry["checkpoint"]).parent
            workspace = open_workspace(config, home, opening)
            samples = make_samples(_tested(system, workspace), config.model.modalities)
            timed = samples[:: ceil(len(samples) / TIMED)]
            recordings[decoded] = [load_sample(sample, workspace.store) for sample in timed]
        counts[member.name] = len(recordings[decoded])
        call = partial(_classify_next, classifier, itertools.cycle(recordings[decoded]))
        functions[system.member.name] = waiting(call, device)
    log.info("Timing %d systems on the same samples.", len(functions))
    timings = interleaved(functions, rounds, WARM_UP)
    return {
        name: Latency(_mean_of_samples(timing.calls, counts[name]), timing.median, timing.p95)
        for name, timing in timings.items()
    }


def _tested(system: Measured, workspace: Workspace) -> Recordings:
    """Recordings of the first tested fold, which the first network has not seen."""
    outcomes = next(iter(system.tests.values()))
    files = {path for outcome in outcomes for path in outcome.files.values()}
    return workspace.recordings.without(
        row for row in workspace.recordings if row.source not in files
    )


def _mean_of_samples(calls: Sequence[float], count: int) -> float:
    """Mean over samples that take turns of each one's median time."""
    return fmean(median(calls[sample::count]) for sample in range(min(count, len(calls))))


def _classify_next(classifier: SurfaceClassifier, samples: Iterator[dict[str, Tensor]]) -> object:
    """Another sample each time: what a sequential decision costs depends on the sample."""
    return classifier.classify(**next(samples))
