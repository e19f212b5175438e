"""Measure a family of systems on the same folds: accuracy against latency, and a choice.

Each tested fold has a partner that is left out of training with it. The system for use is chosen on
all votes; how well such a choice does is measured on each fold by the choice on its partner.
"""

import logging
import shlex
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from statistics import fmean
from typing import Any

from tex_lightning.config import Config, FrontierConfig
from tex_lightning.config.composition import Job
from tex_lightning.config.search import repeated_arguments
from tex_lightning.config.weights import read_config
from tex_lightning.core.console import say
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import read_record
from tex_lightning.errors import UserError
from tex_lightning.evaluation.comparison import (
    Candidate,
    correct_shares,
    one_standard_error,
    pareto,
    partner,
    within_budget,
)
from tex_lightning.evaluation.outcomes import Outcome, environment, summarise, write_results
from tex_lightning.report.figures import save_figure
from tex_lightning.report.frontier_chart import (
    PROCEDURE,
    Point,
    frontier_figure,
    print_frontier,
    write_frontier,
)
from tex_lightning.report.table import is_tiny
from tex_lightning.studies.console_summary import Opening
from tex_lightning.studies.crossval import chosen_folds
from tex_lightning.studies.family import (
    Measured,
    Member,
    Timings,
    check_libraries,
    compose_family,
    given_overrides,
    measure_family,
    measure_latencies,
    with_system,
)
from tex_lightning.studies.sense_subsets import with_subsets

RULE = "one_standard_error_rule"

log = logging.getLogger(__name__)


def compare_family(config: Config, job: Job) -> dict[str, Any]:
    """Measure the family; write table, charts and ``results.json``, and return the latter.

    Systems and folds that an earlier run in the same folder has finished are shown again, and the
    choice is among all of them.

    Args:
        config: Names the family.
        job: Has the run folder, and what the user asked for beside the family.

    Raises:
        UserError: If a system cannot be run, before any is trained.
    """
    begin, directory = time.perf_counter(), job.directory
    held, tested = _earlier(directory)
    frontier = with_subsets(config, job)
    members = list(compose_family(frontier, job, held))
    check_libraries(members)
    folds = sorted({*_tested_folds(config), *tested})
    opening = Opening(config.data, _described(members), folds)
    measured = measure_family(members, folds, directory / "systems", opening)
    timings = measure_latencies(measured, config.frontier.rounds, opening)
    candidates = _candidates(measured, timings, [system.tests for system in measured])
    procedure = _procedure(measured, timings)
    chosen = one_standard_error(candidates).name
    points = _points(measured, timings, chosen, procedure)
    shown = [*points, _procedure_point(procedure, points)]
    write_frontier(shown, directory / "frontier.csv")
    tiny = is_tiny(list(job.overrides))
    if tiny:  # nothing is recommended
        shown = [replace(point, chosen=False) for point in shown]
    figure = frontier_figure(shown)
    save_figure(figure, directory / "frontier")
    results = {
        "task": config.task,
        "data": config.data.name,
        "seed": config.seed,
        "folds": folds,
        "wall_seconds": time.perf_counter() - begin,
        "environment": environment(pick_device(config.trainer.accelerator)),
        "skipped": _skipped(measured),
        "chosen": chosen,
        "command": _command(job, _member(members, chosen)),
        "overrides": list(_member(members, chosen).overrides),
        "procedure": procedure,
        "systems": {point.system: asdict(point) for point in points},
    }
    if frontier.senses is not None:
        results["senses"] = frontier.senses
    write_results(directory / "results.json", results)
    print_frontier(shown, directory, str(results["command"]))
    if not tiny:
        _print_budget(config.frontier, job, members, candidates)
    return results


def _tested_folds(config: Config) -> list[int]:
    """Those of ``crossval.only``, of the first ``frontier.trainings``, or all."""
    trainings, folds = config.frontier.trainings, config.data.folds
    if trainings is None or config.crossval.only is not None:
        return chosen_folds(config)
    without = range(min(trainings, folds))
    return sorted({fold for each in without for fold in (each, partner(each, folds))})


def _earlier(directory: Path) -> tuple[list[str], list[int]]:
    """Systems and folds that the last finished run in the folder has shown."""
    path = directory / "results.json"
    if not path.is_file():
        return [], []
    results = read_record(path)
    return list(results["systems"]), list(results["folds"])


def _described(members: list[Member]) -> str:
    return f"{len(members)} systems: {', '.join(member.name for member in members)}"


def _skipped(measured: list[Measured]) -> list[dict[str, str]]:
    """Files that some system went without, each once."""
    skipped = [each for system in measured for each in system.entry.get("skipped", [])]
    return list({each["path"]: each for each in skipped}.values())


def _macs(system: Measured) -> int | None:
    """Multiply-accumulates of a sample, those that a sequential decision does not do left out."""
    macs: int | None = system.entry["macs_per_sample"]
    if macs is None:
        return None
    return round(macs * fmean(outcome.relative_macs for outcome in system.outcomes))


def _candidates(
    measured: list[Measured],
    timings: Timings,
    votes: Sequence[Mapping[int, Sequence[Outcome]]],
) -> list[Candidate]:
    """The systems by their times and some of their votes, by fold, on samples of all senses."""
    widths = [len(system.member.config.model.modalities) for system in measured]
    joint = votes[widths.index(max(widths))]
    return [
        Candidate(
            system.member.name,
            timings[system.member.name].mean,
            {
                (fold, recording): share
                for fold, outcomes in own.items()
                for recording, share in correct_shares(outcomes, joint[fold]).items()
            },
        )
        for system, own in zip(measured, votes, strict=True)
    ]


def _procedure(measured: list[Measured], timings: Timings) -> dict[str, Any]:
    """How well it does to choose a system and to use it.

    Each fold's votes are those of the system chosen on its partner. In a family of several kinds
    the samples of a fold are that system's own.
    """
    named = {system.member.name: system for system in measured}
    folds, all_votes = [], []
    for fold in measured[0].tests:
        own = [{fold: each.partners[fold]} for each in measured]
        family = _candidates(measured, timings, own)
        system = named[one_standard_error(family).name]
        votes = system.tests[fold]
        all_votes += votes
        choice = {"chosen": system.member.name, "overrides": list(system.member.overrides)}
        folds.append({"fold": fold, **choice, **_counts(summarise(votes))})
    pooled = summarise(all_votes)
    kept = {key: pooled[key] for key in ("vote_accuracy", "vote_ci95")}
    return {"rule": RULE, **kept, **_counts(pooled), "folds": folds}


def _counts(summary: dict[str, Any]) -> dict[str, Any]:
    return {key: summary[key] for key in ("correct", "test_samples")}


def _points(
    measured: list[Measured], timings: Timings, chosen: str, procedure: dict[str, Any]
) -> list[Point]:
    named = {system.member.name: system for system in measured}
    summaries = {name: summarise(system.outcomes) for name, system in named.items()}
    line = pareto(
        {name: (timings[name].mean, summaries[name]["vote_accuracy"]) for name in summaries}
    )
    choices = [fold["chosen"] for fold in procedure["folds"]]
    return [
        Point(
            system=name,
            kind=system.member.config.model.kind,
            parameters=system.entry["parameters"],
            macs=_macs(system),
            latency_ms_median=timings[name].median,
            latency_ms_p95=timings[name].p95,
            fit_seconds=system.fit_seconds,
            vote_accuracy=summaries[name]["vote_accuracy"],
            ci_low=summaries[name]["vote_ci95"][0],
            ci_high=summaries[name]["vote_ci95"][1],
            on_frontier=name in line,
            chosen=name == chosen,
            test_samples=summaries[name]["test_samples"],
            chosen_in_folds=choices.count(name),
            latency_ms_mean=timings[name].mean,
        )
        for name, system in named.items()
    ]


def _procedure_point(procedure: dict[str, Any], points: list[Point]) -> Point:
    """The procedure beside the systems; its times are means over the systems that it used."""
    named = {point.system: point for point in points}
    used = [named[fold["chosen"]] for fold in procedure["folds"]]
    low, high = procedure["vote_ci95"]
    return Point(
        system=RULE,
        kind=PROCEDURE,
        parameters=None,
        macs=None,
        latency_ms_median=fmean(point.latency_ms_median for point in used),
        latency_ms_p95=fmean(point.latency_ms_p95 for point in used),
        fit_seconds=fmean(point.fit_seconds for point in used),
        vote_accuracy=procedure["vote_accuracy"],
        ci_low=low,
        ci_high=high,
        on_frontier=False,
        chosen=False,
        test_samples=procedure["test_samples"],
        chosen_in_folds=None,
        latency_ms_mean=fmean(point.latency_ms_mean for point in used),
    )


def _member(members: list[Member], name: str) -> Member:
    return next(member for member in members if member.name == name)


def _command(job: Job, member: Member) -> str:
    """The command that trains a member on the user's data."""
    overrides = with_system(job, given_overrides(job), member.overrides)
    overrides.sort(key=lambda item: not item.startswith("model="))  # what one looks for first
    arguments = repeated_arguments(overrides, job.searchpath)
    return shlex.join(["python", "-m", "tex_lightning", *arguments])


def _print_budget(
    limits: FrontierConfig, job: Job, members: list[Member], candidates: list[Candidate]
) -> None:
    """Say which system to use under the user's limits."""
    most, least = limits.max_latency_ms, limits.min_accuracy
    if most is None and least is None:
        return
    found = within_budget(candidates, most, least)
    given = [f"{most:g} ms" if most is not None else "", f"{least:.1%}" if least else ""]
    asked = " and ".join(limit for limit in given if limit)
    if found is None:
        say(f"No system of the family meets {asked} on the tested folds.")
        return
    say(
        f"Within {asked}: {found.name}, {found.cost:.1f} ms and {found.accuracy:.1%} correct votes "
        "on all tested folds, which it is picked on as well (slightly optimistic)."
    )
    say(f"Train it with: {_command(job, _member(members, found.name))}", wraps=False)


def resolve_auto(finished: str | None, test_fold: int | None, job: Job) -> Config:
    """The configuration of a job whose ``model=auto`` is the chosen system of a family.

    Args:
        finished: The run folder of the family (``frontier.run``). Without it the family is measured
            here, and chosen on the partner of the tested fold, by networks that have seen neither.
        test_fold: The fold that this run tests.
        job: What was asked for.

    Raises:
        UserError: If ``frontier.run`` holds no finished frontier.
    """
    if finished is not None:
        overrides = _read_choice(Path(finished).expanduser())["overrides"]
    else:
        run = job.directory / "frontier"
        if not (run / "results.json").is_file():  # a second choice may be another one
            given = [item for item in job.overrides if not item.startswith("task=")]
            asked = [*given, "task=frontier", f"crossval.only=[{test_fold}]"]
            compare_family(read_config(job.compose(asked)), replace(job, directory=run))
        (choice,) = _read_choice(run)["procedure"]["folds"]
        overrides = choice["overrides"]
    given = [item for item in job.overrides if not item.startswith("model=")]
    log.info("model=auto is %s.", " ".join(overrides))
    return read_config(job.compose(with_system(job, given, overrides)))


def _read_choice(folder: Path) -> dict[str, Any]:
    path = folder / "results.json"
    try:
        results = read_record(path)
        return {key: results[key] for key in ("overrides", "procedure")}
    except (UserError, KeyError) as error:
        raise UserError(
            f"frontier.run={folder} holds no finished frontier; give the run folder of a "
            "task=frontier, or leave it out."
        ) from error
