"""Train and measure a family of systems on the same folds: accuracy against latency.

Each tested fold has a validation fold of its own, which takes no part in training. Accuracies and
the Pareto line are drawn from the tested folds; which system is enough is decided on the
validation folds alone.
"""

import json
import logging
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from hydra import compose
from hydra.core.hydra_config import HydraConfig

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.data.datamodule import load_sample
from tex_lightning.data.folds import make_samples
from tex_lightning.data.recordings import Recordings
from tex_lightning.decision.choice import Candidate, one_standard_error, pareto, within_budget
from tex_lightning.devices import pick_device
from tex_lightning.errors import UserError
from tex_lightning.inference.sequential import prepare
from tex_lightning.profiling.timing import interleaved, waiting
from tex_lightning.report.frontier import Point, draw_frontier, print_frontier, write_frontier
from tex_lightning.report.results import (
    Outcome,
    environment,
    read_outcomes,
    summarise,
    write_outcomes,
    write_results,
)
from tex_lightning.schema import Config
from tex_lightning.tasks.crossval import chosen_folds
from tex_lightning.tasks.fit import fit_fold
from tex_lightning.tasks.samples import run_test
from tex_lightning.tasks.weights import read_config
from tex_lightning.tasks.workspace import Workspace, open_workspace
from tex_lightning.validation import check_config

log = logging.getLogger(__name__)

OWN_KEYS = ("task=", "frontier", "model=", "crossval.", "hydra")
DONE = "measured.json"
WARM_UP = 3


@dataclass(frozen=True)
class Member:
    """One system of the family: its name, its overrides and what they compose to."""

    name: str
    overrides: tuple[str, ...]
    config: Config


@dataclass(frozen=True)
class Measured:
    """What training and testing a member gave.

    Attributes:
        member: The system.
        entry: Facts of the first fold's network: parameters, arithmetic, checkpoint.
        fit_seconds: Mean over the folds, parts of a FusionNet included.
        tests: Outcomes on the tested folds.
        validation: Outcomes on their validation folds.
    """

    member: Member
    entry: dict[str, Any]
    fit_seconds: float
    tests: list[Outcome]
    validation: list[Outcome]


def run(config: Config, directory: Path) -> dict[str, Any]:
    """Measure the family; write table, charts and ``results.json``, and return the latter."""
    begin = time.perf_counter()
    members = list(_members(config, directory / "networks"))
    folds = chosen_folds(config)
    measured = [_measure(member, folds, directory / "systems" / member.name) for member in members]
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
        "chosen": chosen.system,
        "command": _command(members, chosen.system),
        "overrides": list(_member(members, chosen.system).overrides),
        "systems": {point.system: asdict(point) for point in points},
    }
    write_results(directory / "results.json", results)
    print_frontier(points, directory, str(results["command"]))
    _print_budget(config, members, candidates)
    return results


def _members(config: Config, shared: Path) -> Iterator[Member]:
    """Compose every system of the family with whatever else the user asked for.

    Networks that differ in nothing but how they are run are trained once, in ``shared``.

    Raises:
        UserError: If a system is unknown or its configuration cannot be used.
    """
    family, only = config.frontier.systems, config.frontier.only
    unknown = [name for name in only or () if name not in family]
    if unknown:
        raise UserError(
            f"frontier.only names {unknown[0]}, which this family does not have: choose from "
            f"{', '.join(family)}."
        )
    given = _given()
    for name in only or family:
        overrides = tuple(family[name].split())
        composed = compose("config", overrides=[*given, "task=crossval", *overrides])
        member = read_config(composed)
        if member.model.kind == "haptic":
            member = replace(member, weights=None)  # for the photos' networks of the family
        member = replace(member, crossval=replace(member.crossval, share=str(shared)))
        check_config(member, ("crossval",))
        yield Member(name, overrides, member)


def _measure(member: Member, folds: list[int], directory: Path) -> Measured:
    """Train and test on every fold, or read what an interrupted run has left."""
    log.info("System %s.", member.name)
    workspace: Workspace | None = None
    entries, tests, validation = [], [], []
    for fold in folds:
        place = directory / str(fold)
        if not (place / DONE).is_file():
            workspace = workspace or open_workspace(member.config, directory)
            _measure_fold(workspace, fold, place)
        entries.append(json.loads((place / DONE).read_text(encoding="utf-8")))
        kind = member.config.model.kind
        tests += read_outcomes(place / "predictions" / f"{kind}.csv")
        validation += read_outcomes(place / "validation.csv")
    seconds = sum(entry["fit_seconds"] for entry in entries) / len(entries)
    return Measured(member, entries[0], seconds, tests, validation)


def validation_fold(fold: int, folds: int) -> int:
    """The fold that choices are made on when ``fold`` is tested: the one half the folds away."""
    return (fold + folds // 2) % folds


def _measure_fold(workspace: Workspace, fold: int, directory: Path) -> None:
    held = validation_fold(fold, workspace.config.data.folds)
    folds = workspace.config.data.folds
    kept = tuple(row for row in workspace.recordings if row.group % folds != held)
    inner = replace(workspace, recordings=Recordings(kept)).on_fold(fold, directory)
    networks = fit_fold(inner)
    entry = networks[workspace.kind]
    rows = tuple(row for row in workspace.recordings if row.group % folds == held)
    samples = make_samples(Recordings(rows), workspace.kind)
    classifier = prepare(load_classifier(entry["checkpoint"]), workspace.config)
    outcomes = run_test(classifier, samples, workspace.store)
    write_outcomes(outcomes, directory / "validation.csv")
    seconds = sum(network["fit_seconds"] for network in networks.values())
    write_results(directory / DONE, {**entry, "fit_seconds": seconds})


def _latencies(measured: list[Measured], config: Config) -> dict[str, tuple[float, float]]:
    """Median and 95th percentile in ms of one sample, all systems by turns in one run."""
    functions, recordings = {}, {}
    for system in measured:
        member, kind = system.member.config, system.member.config.model.kind
        device = pick_device(member.trainer.accelerator)
        classifier = prepare(load_classifier(system.entry["checkpoint"]).to(device), member)
        if kind not in recordings:  # all systems of a kind classify the same sample
            workspace = open_workspace(member, Path(system.entry["checkpoint"]).parent)
            sample = make_samples(workspace.recordings, workspace.kind)[0]
            recordings[kind] = load_sample(sample, workspace.store)
        call = partial(classifier.classify, *recordings[kind])
        functions[system.member.name] = waiting(call, device)
    timings = interleaved(functions, config.frontier.rounds, WARM_UP)
    return {name: (timing.median, timing.p95) for name, timing in timings.items()}


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
                macs=system.entry["macs_per_sample"],
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
    return " ".join(["python -m tex_lightning", *_member(members, name).overrides, *_given()])


def _given() -> list[str]:
    """What the user asked for beside the family."""
    return [item for item in HydraConfig.get().overrides.task if not item.startswith(OWN_KEYS)]


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
