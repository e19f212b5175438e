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

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.config.search import repeated_arguments
from tex_lightning.config.weights import read_config
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import read_record
from tex_lightning.errors import UserError
from tex_lightning.evaluation.comparison import (
    Candidate,
    correct_shares,
    one_standard_error,
    pareto,
    partner,
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
from tex_lightning.studies.family import (
    System,
    Timings,
    chosen_senses,
    compose_family,
    measure_family,
    measure_latencies,
    with_system,
)
from tex_lightning.studies.fold import chosen_folds

RULE = "one_standard_error_rule"

log = logging.getLogger(__name__)


def run(config: Config, job: Job) -> dict[str, Any]:
    """Measure the family; write table, chart and ``results.json``, and return the latter.

    What an earlier run in the same folder has trained is not trained again.

    Args:
        config: Names the family.
        job: Has the run folder, and what the user asked for beside the family.

    Raises:
        UserError: If a system cannot be run, before any is trained.
    """
    begin, directory = time.perf_counter(), job.directory
    members, folds = compose_family(config, job), _tested_folds(config)
    measure_family(members, folds, directory / "systems")
    timings = measure_latencies(members, config.frontier.rounds)
    candidates = _candidates(members, timings, [member.tests for member in members])
    procedure = _procedure(members, timings)
    chosen = one_standard_error(candidates).name
    points = _points(members, timings, chosen, procedure)
    shown = [*points, _procedure_point(procedure, points)]
    write_frontier(shown, directory / "frontier.csv")
    if is_tiny(list(job.overrides)):  # nothing is recommended
        shown = [replace(point, chosen=False) for point in shown]
    save_figure(frontier_figure(shown), directory / "frontier")
    overrides = next(member.overrides for member in members if member.name == chosen)
    results = {
        "task": config.task,
        "data": config.data.name,
        "seed": config.seed,
        "folds": folds,
        "wall_seconds": time.perf_counter() - begin,
        "environment": environment(pick_device(config.trainer.accelerator)),
        "skipped": _skipped(members),
        "chosen": chosen,
        "command": _command(job, overrides),
        "overrides": overrides,
        "procedure": procedure,
        "systems": {point.system: asdict(point) for point in points},
    }
    if config.frontier.senses is not None:
        results["senses"] = chosen_senses(config)
    write_results(directory / "results.json", results)
    print_frontier(shown, directory, str(results["command"]))
    return results


def _tested_folds(config: Config) -> list[int]:
    """Those of ``crossval.only``, of the first ``frontier.trainings``, or all."""
    trainings, folds = config.frontier.trainings, config.data.folds
    if trainings is None or config.crossval.only is not None:
        return chosen_folds(config)
    without = range(min(trainings, folds))
    return sorted({fold for each in without for fold in (each, partner(each, folds))})


def _skipped(members: Sequence[System]) -> list[dict[str, str]]:
    """Files that some system went without, each once."""
    skipped = [each for member in members for each in member.entry.get("skipped", [])]
    return list({each["path"]: each for each in skipped}.values())


def _macs(system: System) -> int | None:
    """Multiply-accumulates of a sample, those that a sequential decision does not do left out."""
    macs: int | None = system.entry["macs_per_sample"]
    if macs is None:
        return None
    return round(macs * fmean(outcome.relative_macs for outcome in system.outcomes))


def _candidates(
    members: Sequence[System],
    timings: Timings,
    votes: Sequence[Mapping[int, Sequence[Outcome]]],
) -> list[Candidate]:
    """The systems by their times and some of their votes, by fold, on samples of all senses."""
    widths = [len(member.config.model.modalities) for member in members]
    joint = votes[widths.index(max(widths))]
    return [
        Candidate(
            member.name,
            timings[member.name].mean,
            {
                (fold, recording): share
                for fold, outcomes in own.items()
                for recording, share in correct_shares(outcomes, joint[fold]).items()
            },
        )
        for member, own in zip(members, votes, strict=True)
    ]


def _procedure(members: Sequence[System], timings: Timings) -> dict[str, Any]:
    """How well it does to choose a system and to use it.

    Each fold's votes are those of the system chosen on its partner. In a family of several kinds
    the samples of a fold are that system's own.
    """
    named = {member.name: member for member in members}
    folds, all_votes = [], []
    for fold in members[0].tests:
        own = [{fold: each.partners[fold]} for each in members]
        system = named[one_standard_error(_candidates(members, timings, own)).name]
        votes = system.tests[fold]
        all_votes += votes
        choice = {"chosen": system.name, "overrides": system.overrides}
        folds.append({"fold": fold, **choice, **_counts(summarise(votes))})
    pooled = summarise(all_votes)
    kept = {key: pooled[key] for key in ("vote_accuracy", "vote_ci95")}
    return {"rule": RULE, **kept, **_counts(pooled), "folds": folds}


def _counts(summary: dict[str, Any]) -> dict[str, Any]:
    return {key: summary[key] for key in ("correct", "test_samples")}


def _points(
    members: Sequence[System], timings: Timings, chosen: str, procedure: dict[str, Any]
) -> list[Point]:
    summaries = {member.name: summarise(member.outcomes) for member in members}
    line = pareto(
        {name: (timings[name].mean, each["vote_accuracy"]) for name, each in summaries.items()}
    )
    choices = [fold["chosen"] for fold in procedure["folds"]]
    points = []
    for member in members:
        name, summary = member.name, summaries[member.name]
        low, high = summary["vote_ci95"]
        points.append(
            Point(
                system=name,
                kind=member.config.model.kind,
                parameters=member.entry["parameters"],
                macs=_macs(member),
                latency_ms_median=timings[name].median,
                latency_ms_p95=timings[name].p95,
                fit_seconds=member.fit_seconds,
                vote_accuracy=summary["vote_accuracy"],
                ci_low=low,
                ci_high=high,
                on_frontier=name in line,
                chosen=name == chosen,
                test_samples=summary["test_samples"],
                chosen_in_folds=choices.count(name),
                latency_ms_mean=timings[name].mean,
            )
        )
    return points


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


def _command(job: Job, overrides: Sequence[str]) -> str:
    """The command that trains a system on the user's data."""
    ordered = sorted(with_system(job, overrides), key=lambda item: not item.startswith("model="))
    arguments = repeated_arguments(ordered, job.searchpath)
    return shlex.join(["python", "-m", "tex_lightning", *arguments])


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
        folder = job.directory / "frontier"
        if not (folder / "results.json").is_file():  # a second choice may be another one
            given = [item for item in job.overrides if not item.startswith("task=")]
            asked = [*given, "task=frontier", "data.val_fold=null", f"crossval.only=[{test_fold}]"]
            run(read_config(job.compose(asked)), replace(job, directory=folder))
        (choice,) = _read_choice(folder)["procedure"]["folds"]
        overrides = choice["overrides"]
    log.info("model=auto is %s.", " ".join(overrides))
    return read_config(job.compose(with_system(job, overrides)))


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
