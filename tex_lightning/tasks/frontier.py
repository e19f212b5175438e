"""Measure a family of systems on the same folds: accuracy against latency, and a choice.

The system for use is chosen on all votes; how well such a choice does is measured on each fold by
the choice on the others.
"""

import shlex
import time
from collections.abc import Sequence
from statistics import fmean
from typing import Any

from omegaconf import OmegaConf

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import write_rows
from tex_lightning.evaluation.comparison import (
    correct_shares,
    one_standard_error,
    pareto,
)
from tex_lightning.evaluation.outcomes import environment, summarise, write_results
from tex_lightning.report.figures import save_figure
from tex_lightning.report.frontier_chart import (
    frontier_figure,
    print_frontier,
)
from tex_lightning.studies.family import (
    System,
    compose_family,
    measure_family,
    with_system,
)
from tex_lightning.studies.fold import chosen_folds


def run(config: Config, job: Job) -> dict[str, Any]:
    """Measure the family; write table, chart and ``results.json``, and return the latter.

    What an earlier run in the same folder has trained is not trained again.

    Raises:
        UserError: If a system cannot be run, before any is trained.
    """
    begin, directory = time.perf_counter(), job.directory
    systems = compose_family(config, job)
    folds = chosen_folds(config.data.folds, config.crossval.only)
    measure_family(systems, folds, directory / "systems")
    chosen = _choose(systems, folds)
    rows, procedure = _rows(systems, chosen), _measure_choice(systems)
    write_rows(directory / "frontier.csv", rows[0], (row.values() for row in rows))
    save_figure(frontier_figure(rows), directory / "frontier")
    results = {
        "task": config.task,
        "data": config.data.name,
        "seed": config.seed,
        "folds": folds,
        "wall_seconds": time.perf_counter() - begin,
        "environment": environment(pick_device(config.trainer.accelerator)),
        "chosen": chosen.name,
        "command": _command(job, chosen.overrides),
        "overrides": chosen.overrides,
        "procedure": procedure,
        "systems": {row["system"]: row for row in rows},
    }
    write_results(directory / "results.json", results)
    print_frontier(rows, procedure, directory, str(results["command"]))
    return results


def _choose(systems: Sequence[System], folds: Sequence[int]) -> System:
    """Choose a system by its time and its votes on some folds, on samples of all senses."""
    widths = [len(system.config.model.modalities) for system in systems]
    joint = systems[widths.index(max(widths))].tests
    named = {system.name: system for system in systems}
    votes = {
        name: {
            (fold, recording): share
            for fold in folds
            for recording, share in correct_shares(system.tests[fold], joint[fold]).items()
        }
        for name, system in named.items()
    }
    return named[one_standard_error({name: x.cost for name, x in named.items()}, votes)]


def _measure_choice(systems: Sequence[System]) -> dict[str, Any] | None:
    """Measure how well it does to choose a system: each fold by the choice on the others.

    In a family of several kinds the samples of a fold are those of the chosen system.

    Returns:
        None of a single fold.
    """
    folds = [*systems[0].tests]
    if len(folds) < 2:
        return None
    choices = {
        fold: _choose(systems, [other for other in folds if other != fold]) for fold in folds
    }
    summary = summarise([vote for fold in folds for vote in choices[fold].tests[fold]])
    keys = ("vote_accuracy", "vote_ci95", "correct", "test_samples")
    names = {fold: system.name for fold, system in choices.items()}
    return {**{key: summary[key] for key in keys}, "chosen": names}


def _rows(systems: Sequence[System], chosen: System) -> list[dict[str, Any]]:
    """Return the rows of ``frontier.csv``, fastest first."""
    summaries = {system.name: summarise(system.outcomes) for system in systems}
    accuracies = {name: summary["vote_accuracy"] for name, summary in summaries.items()}
    line = pareto({system.name: (system.cost, accuracies[system.name]) for system in systems})
    rows = []
    for system in sorted(systems, key=lambda system: system.cost):
        macs = system.entry["macs_per_sample"]
        if macs is not None:  # those that a sequential decision does not do are left out
            macs = round(macs * fmean(outcome.relative_macs for outcome in system.outcomes))
        summary = summaries[system.name]
        low, high = summary["vote_ci95"]
        row = {
            "system": system.name,
            "kind": system.config.model.kind,
            "parameters": system.entry["parameters"],
            "macs": macs,
            "latency_ms_median": summary["latency_ms"]["median"],
            "latency_ms_p95": summary["latency_ms"]["p95"],
            "fit_seconds": system.fit_seconds,
            "vote_accuracy": accuracies[system.name],
            "ci_low": low,
            "ci_high": high,
            "on_frontier": system.name in line,
            "chosen": system is chosen,
            "latency_ms_mean": system.cost,
        }
        rows.append(row)
    return rows


def _command(job: Job, overrides: Sequence[str]) -> str:
    """Return the command that trains a system on the user's data."""
    sources = OmegaConf.select(job.hydra, "hydra.runtime.config_sources", default=[])
    folders = [source.path for source in sources if source.provider == "command-line"]
    flags = [part for folder in folders for part in ("--config-dir", str(folder))]
    ordered = sorted(with_system(job, overrides), key=lambda item: not item.startswith("model="))
    return shlex.join(["python", "-m", "tex_lightning", *flags, *job.searchpath, *ordered])
