"""Measure a family of systems on the same folds: accuracy against latency, a chart and a choice."""

import shlex
import time
from collections.abc import Sequence
from typing import Any

from omegaconf import OmegaConf

from tex_lightning.config import Config, Job
from tex_lightning.core.files import write_rows
from tex_lightning.report.figures import save_figure
from tex_lightning.report.frontier_chart import frontier_figure, print_frontier
from tex_lightning.studies.family import (
    choose_system,
    compose_family,
    frontier_rows,
    measure_family,
    tested_samples,
    with_system,
)
from tex_lightning.studies.fold import chosen_folds
from tex_lightning.studies.network_results import run_facts


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
    chosen = choose_system(systems)
    baselines = [system.config.model.baseline is not None for system in systems]
    rows = frontier_rows(systems, chosen)
    write_rows(directory / "frontier.csv", rows[0], (row.values() for row in rows))
    samples, chance = tested_samples(systems)
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


def _command(job: Job, overrides: Sequence[str]) -> str:
    """Return the command that trains a system on the user's data."""
    sources = OmegaConf.select(job.hydra, "hydra.runtime.config_sources", default=[])
    folders = [source.path for source in sources if source.provider == "command-line"]
    flags = [part for folder in folders for part in ("--config-dir", str(folder))]
    ordered = sorted(with_system(job, overrides), key=lambda item: not item.startswith("model="))
    return shlex.join(["python", "-m", "tex_lightning", *flags, *job.searchpath, *ordered])
