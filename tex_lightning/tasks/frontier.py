"""A family of systems on the same folds: accuracy against latency, and which of them is enough.

Accuracies and the Pareto line are drawn from the tested folds; which system is enough is decided on
the validation folds alone.
"""

import itertools
import logging
import shlex
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any

from torch import Tensor

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.data.datamodule import load_sample
from tex_lightning.data.decode import DecodeSettings
from tex_lightning.data.folds import make_samples
from tex_lightning.devices import pick_device
from tex_lightning.evaluation.choice import Candidate, one_standard_error, pareto, within_budget
from tex_lightning.evaluation.outcomes import (
    environment,
    summarise,
    write_results,
)
from tex_lightning.inference.early_stopping import prepare
from tex_lightning.profiling.timing import interleaved, waiting
from tex_lightning.report.frontier_chart import Point, draw_frontier, print_frontier, write_frontier
from tex_lightning.runs.family import (
    Measured,
    Member,
    compose_family,
    given_overrides,
    measure,
    with_system,
)
from tex_lightning.runs.workspace import decode_settings, open_workspace
from tex_lightning.tasks.crossval import chosen_folds

log = logging.getLogger(__name__)

WARM_UP = 3
TIMED = 10  # samples that are timed by turns


def run(config: Config, directory: Path) -> dict[str, Any]:
    """Measure the family; write table, charts and ``results.json``, and return the latter."""
    begin = time.perf_counter()
    members = list(compose_family(config, directory / "networks"))
    folds = chosen_folds(config)
    measured = [measure(member, folds, directory / "systems" / member.name) for member in members]
    timings = _latencies(measured, config)
    candidates = _candidates(measured, timings)
    points = _points(measured, timings, one_standard_error(candidates).name)
    write_frontier(points, directory / "frontier.csv")
    draw_frontier(points, directory)
    chosen = next(point for point in points if point.chosen)
    results = {
        "task": config.task,
        "data": config.data.name,
        "seed": config.seed,
        "folds": folds,
        "wall_seconds": time.perf_counter() - begin,
        "environment": environment(pick_device(config.trainer.accelerator)),
        "skipped": _skipped(measured),
        "chosen": chosen.system,
        "command": _command(members, chosen.system),
        "overrides": list(_member(members, chosen.system).overrides),
        "systems": {point.system: asdict(point) for point in points},
    }
    write_results(directory / "results.json", results)
    print_frontier(points, directory, str(results["command"]))
    _print_budget(config, members, candidates)
    return results


def _latencies(measured: list[Measured], config: Config) -> dict[str, tuple[float, float]]:
    """Median and 95th percentile in ms of one sample, all systems by turns in one run."""
    functions: dict[str, Callable[[], object]] = {}
    recordings: dict[tuple[str, DecodeSettings], list[tuple[Tensor | None, Tensor | None]]] = {}
    for system in measured:
        member, kind = system.member.config, system.member.config.model.kind
        device = pick_device(member.trainer.accelerator)
        classifier = prepare(load_classifier(system.entry["checkpoint"]).to(device), member)
        decoded = kind, decode_settings(member.data)
        if decoded not in recordings:  # all systems of a kind classify the same samples
            workspace = open_workspace(member, Path(system.entry["checkpoint"]).parent)
            samples = make_samples(workspace.recordings, workspace.kind)
            timed = samples[:: max(1, len(samples) // TIMED)][:TIMED]
            recordings[decoded] = [load_sample(sample, workspace.store) for sample in timed]
        call = partial(_classify_next, classifier, itertools.cycle(recordings[decoded]))
        functions[system.member.name] = waiting(call, device)
    timings = interleaved(functions, config.frontier.rounds, WARM_UP)
    return {name: (timing.median, timing.p95) for name, timing in timings.items()}


def _classify_next(
    classifier: SurfaceClassifier, samples: Iterator[tuple[Tensor | None, Tensor | None]]
) -> object:
    """Another sample each time: what a sequential decision costs depends on the sample."""
    return classifier.classify(*next(samples))


def _skipped(measured: list[Measured]) -> list[dict[str, str]]:
    """Files that some system went without, each once."""
    skipped = [each for system in measured for each in system.entry.get("skipped", [])]
    return list({each["path"]: each for each in skipped}.values())


def _macs(system: Measured) -> int | None:
    """Multiply-accumulates of a sample, those that a sequential decision does not do left out."""
    macs: int | None = system.entry["macs_per_sample"]
    if macs is None:
        return None
    return round(macs * fmean(outcome.evidence for outcome in system.tests))


def _points(
    measured: list[Measured], timings: dict[str, tuple[float, float]], chosen: str
) -> list[Point]:
    summaries = {system.member.name: summarise(system.tests) for system in measured}
    line = pareto(
        {name: (timings[name][0], summaries[name]["vote_accuracy"]) for name in summaries}
    )
    points = []
    for system in measured:
        name, tested = system.member.name, summaries[system.member.name]
        low, high = tested["vote_ci95"]
        points.append(
            Point(
                system=name,
                kind=system.member.config.model.kind,
                parameters=system.entry["parameters"],
                macs=_macs(system),
                latency_ms_median=timings[name][0],
                latency_ms_p95=timings[name][1],
                fit_seconds=system.fit_seconds,
                vote_accuracy=tested["vote_accuracy"],
                ci_low=low,
                ci_high=high,
                on_frontier=name in line,
                chosen=name == chosen,
                test_samples=tested["test_samples"],
                validation_accuracy=summarise(system.validation)["vote_accuracy"],
                validation_samples=len(system.validation),
            )
        )
    return points


def _candidates(
    measured: list[Measured], timings: dict[str, tuple[float, float]]
) -> list[Candidate]:
    return [
        Candidate(
            system.member.name,
            timings[system.member.name][0],
            {item.sample: item.label == item.predicted for item in system.validation},
        )
        for system in measured
    ]


def _member(members: list[Member], name: str) -> Member:
    return next(member for member in members if member.name == name)


def _command(members: list[Member], name: str) -> str:
    """What trains a member on the user's data."""
    overrides = with_system(given_overrides(), _member(members, name).overrides)
    overrides.sort(key=lambda item: not item.startswith("model="))  # what one looks for first
    return shlex.join(["python", "-m", "tex_lightning", *overrides])


def _print_budget(config: Config, members: list[Member], candidates: list[Candidate]) -> None:
    """Say which system to use under the user's limits."""
    most, least = config.frontier.max_latency_ms, config.frontier.min_accuracy
    if most is None and least is None:
        return
    found = within_budget(candidates, most, least)
    limits = [f"{most:g} ms" if most is not None else "", f"{least:.1%}" if least else ""]
    asked = " and ".join(limit for limit in limits if limit)
    if found is None:
        log.warning("No system of the family meets %s on the validation folds.", asked)
        return
    log.info(
        "Within %s: %s, %.1f ms and %.1f %% of validation votes; train it with: %s",
        asked, found.name, found.cost, 100 * found.accuracy, _command(members, found.name),
    )  # fmt: skip
