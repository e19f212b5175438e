"""Measure a family of systems on the same folds: accuracy against latency, a chart and a choice."""

import shlex
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from omegaconf import OmegaConf

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.console import console, say
from tex_lightning.core.files import write_rows
from tex_lightning.evaluation.comparison import correct_shares, one_standard_error, pareto
from tex_lightning.evaluation.metrics import METRICS, metrics_in, pooled_metrics
from tex_lightning.evaluation.outcomes import run_facts
from tex_lightning.report.figures import save_figure
from tex_lightning.report.frontier_chart import FrontierRow, frontier_figure
from tex_lightning.report.table import make_table, print_tables
from tex_lightning.studies.family import System, compose_family, measure_family, with_system
from tex_lightning.studies.fold import chosen_folds

COLUMNS = {  # of ``frontier.csv``, with the metric that each has; further metrics come last
    "parameters": "parameters",
    "macs": "macs_per_sample",
    "latency_ms_median": "latency_ms",
    "latency_ms_p95": "latency_ms_p95",
    "fit_seconds": "fit_seconds",
    "vote_accuracy": "vote_accuracy",
    "ci_low": "ci_low",
    "ci_high": "ci_high",
}


def run(config: Config, job: Job) -> dict[str, Any]:
    """Measure the family; write table and chart.

    What an earlier run in the same folder has trained is not trained again.

    Raises:
        UserError: If a system cannot be run, before any is trained.
    """
    begin, directory = time.perf_counter(), job.directory
    systems = compose_family(config, job)
    folds = chosen_folds(config.data.folds, config.crossval.only)
    measure_family(systems, folds, directory / "systems")
    chosen = _choose(systems)
    baselines = [system.config.model.baseline is not None for system in systems]
    rows = _rows(systems, chosen)
    write_rows(directory / "frontier.csv", rows[0], (row.values() for row in rows))
    samples, chance = _tested(systems)
    part = f"fold {folds[0]}" if len(folds) == 1 else f"{len(folds)} folds"
    tested = f"{samples} of {config.data.name}, {part}"
    save_figure(frontier_figure(rows, tested, chance), directory / "frontier")
    results = {
        **run_facts(config, time.perf_counter() - begin, baselines),
        "folds": folds,
        "chosen": chosen.name,
        "command": _command(job, chosen.overrides),
        "overrides": chosen.overrides,
        "systems": {row["system"]: row for row in rows},
    }
    print_frontier(rows, directory, str(results["command"]))
    return results


def _tested(systems: Sequence[System]) -> tuple[str, float]:
    """Return the number of test samples, in which senses may differ, and the accuracy of guessing.

    A tested fold may lack classes, which are guessed nevertheless.
    """
    counts = sorted({len(system.outcomes) for system in systems})
    said = " to ".join(map(str, dict.fromkeys((counts[0], counts[-1]))))
    return f"{said} test samples", 1 / len(systems[0].outcomes[0].class_probabilities)


def _choose(systems: Sequence[System]) -> System:
    """Choose a system by its time and its accuracy on samples of all senses."""
    widths = [len(system.config.model.modalities) for system in systems]
    joint = systems[widths.index(max(widths))].tests
    named = {system.name: system for system in systems}
    votes = {
        name: {
            (fold, recording): share
            for fold in joint
            for recording, share in correct_shares(system.tests[fold], joint[fold]).items()
        }
        for name, system in named.items()
    }
    return named[one_standard_error({name: x.cost for name, x in named.items()}, votes)]


def _rows(systems: Sequence[System], chosen: System) -> list[dict[str, Any]]:
    """Return the rows of ``frontier.csv``, fastest first."""
    entries = {system.name: _entry(system) for system in systems}
    points = {
        system.name: (system.cost, entries[system.name]["vote_accuracy"]) for system in systems
    }
    line = pareto(points)
    further = [metric for metric in metrics_in("frontier") if metric.name not in COLUMNS.values()]
    rows = []
    for system in sorted(systems, key=lambda system: system.cost):
        entry = entries[system.name]
        row = {
            "system": system.name,
            "kind": system.config.model.kind,
            **{column: METRICS[name].of(entry) for column, name in COLUMNS.items()},
            "on_frontier": system.name in line,
            "chosen": system is chosen,
            "latency_ms_mean": system.cost,
            "name": system.label,
            **{metric.name: metric.of(entry) for metric in further},
        }
        rows.append(row)
    return rows


def _entry(system: System) -> dict[str, Any]:
    """Return what ``results.json`` would say of a system on all tested folds."""
    pooled = pooled_metrics(system.outcomes, calibrated=False)
    macs = system.entry["macs_per_sample"]
    if macs is not None:  # those that a sequential decision does not do are left out
        macs = round(macs * fmean(outcome.relative_macs for outcome in system.outcomes))
    return {
        **system.entry, **pooled, "macs_per_sample": macs, "fit_seconds": system.fit_seconds
    }  # fmt: skip


def _command(job: Job, overrides: Sequence[str]) -> str:
    """Return the command that trains a system on the user's data."""
    sources = OmegaConf.select(job.hydra, "hydra.runtime.config_sources", default=[])
    folders = [source.path for source in sources if source.provider == "command-line"]
    flags = [part for folder in folders for part in ("--config-dir", str(folder))]
    ordered = sorted(with_system(job, overrides), key=lambda item: not item.startswith("model="))
    return shlex.join(["python", "-m", "tex_lightning", *flags, *job.searchpath, *ordered])


def print_frontier(rows: Sequence[FrontierRow], directory: Path, command: str) -> None:
    """Print one line per system, and how to train the chosen one."""
    table = make_table("frontier", ["system"], ["accuracy", "95 % CI", "ms", "fit s", "parameters"])
    table.caption = "ms: mean of one sample"
    for row in rows:
        table.add_row(
            row["name"] + (" (chosen)" if row["chosen"] else ""),
            METRICS["vote_accuracy"].text(row["vote_accuracy"]),
            f"{100 * row['ci_low']:.1f}-{100 * row['ci_high']:.1f}",
            f"{row['latency_ms_mean']:.1f}",
            METRICS["fit_seconds"].text(row["fit_seconds"]),
            METRICS["parameters"].text(row["parameters"]),
            style=None if row["on_frontier"] else "dim",
        )
    console.print(table)
    (chosen,) = (row for row in rows if row["chosen"])
    say(
        f"{chosen['name']} is chosen on all tested samples, so its own accuracy of "
        f"{chosen['vote_accuracy']:.1%} is optimistic, and holds for these classes."
    )
    say(f"Train it with: {command}", wraps=False)
    print_tables(directory)
