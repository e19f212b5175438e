"""Find where systems fail: perturb their test recordings at increasing severity and vote."""

import logging
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.config.keys import choice
from tex_lightning.config.model import FUSION
from tex_lightning.core.devices import pick_device
from tex_lightning.core.progress import stage
from tex_lightning.data.store import skipped_entry
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import environment, write_results
from tex_lightning.learning.loggers import log_stability
from tex_lightning.perturbations.table import (
    BOTH,
    SEVERITIES,
    Perturbation,
    perturbations,
    read_severities,
    signal_perturbations,
)
from tex_lightning.report.figures import save_figure
from tex_lightning.report.stability_charts import (
    print_stability,
    stability_figures,
    write_breaks,
    write_trials,
)
from tex_lightning.studies.perturbed import System
from tex_lightning.studies.systems import load_systems, skipped_files
from tex_lightning.studies.trials import (
    RECORD,
    Bench,
    Break,
    Record,
    Trial,
    conflict_summary,
    mean_errors,
    summarise_system,
)

SEVERAL = {BOTH: "several senses"}

log = logging.getLogger(__name__)


def perturb_systems(config: Config, job: Job) -> dict[str, Any]:
    """Test ``stability.systems`` under all perturbations that they meet; write tables and figures.

    The first system is the reference of the mean corruption error. A run that was stopped goes on
    with the same command and ``hydra.run.dir``.
    """
    begin, directory = time.perf_counter(), job.directory
    device = pick_device(config.trainer.accelerator)
    systems = load_systems(config)
    chosen = _chosen(config, systems)
    _try_own(chosen, systems)
    trials, bench, breaks = _run_trials(config, systems, chosen, directory)
    directory.mkdir(parents=True, exist_ok=True)
    write_trials(trials, directory)
    write_breaks(breaks, directory)
    figures = stability_figures(trials)
    for title, figure in figures.items():
        save_figure(figure, directory / "figures" / title)
    log_stability(config.logger, directory, _curves(trials), figures)
    results = {
        "task": config.task,
        "data": config.data.name,
        "seed": config.seed,
        "wall_seconds": time.perf_counter() - begin,
        "environment": environment(device),
        "engine": asdict(config.engine),
        "bound": config.stability.bound,
        "reference": systems[0].name,
        "perturbations": {each.name: asdict(each) for each in chosen},
        "skipped": skipped_entry(skipped_files(systems)),
        "systems": _entries(bench, trials, breaks),
    }
    write_results(directory / "results.json", results)
    print_stability(results, directory)
    return results


def _chosen(config: Config, systems: Sequence[System]) -> list[Perturbation]:
    """Those asked for that some system meets; what is left out is said."""
    known, only = dict(perturbations()), config.stability.only
    for system in systems:
        for branch in system.members[0].evaluator.classifier.senses.values():
            if branch.medium == "signal":
                known |= signal_perturbations(branch.modality)
    for path in config.stability.severities:
        known |= read_severities(path)
    for name in only or ():
        if complaint := next(choice("stability.only", name, tuple(known)), None):
            raise UserError(f"{complaint}.")
    asked = list(known.values()) if only is None else [known[name] for name in only]
    chosen = [each for each in asked if any(system.meets(each) for system in systems)]
    left_out = [each.name for each in asked if each not in chosen]
    if not chosen:
        raise UserError(
            f"No system meets {', '.join(left_out)}; choose other stability.only or systems."
        )
    if left_out:
        senses = Counter(each.modality for each in asked if each not in chosen)
        counts = " and ".join(
            f"{count} of {SEVERAL.get(sense, sense)}" for sense, count in senses.items()
        )
        log.info("Perturbations that no system meets are left out: %s.", counts)
        log.debug("Left out: %s.", ", ".join(left_out))
    return chosen


def _try_own(chosen: Sequence[Perturbation], systems: Sequence[System]) -> None:
    """Apply every function of the user's to one recording, before time is spent.

    Raises:
        UserError: If one returns no finite recording.
    """
    for each in chosen:
        if each.is_users and each.modality != BOTH:
            member = next(system for system in systems if system.meets(each)).members[0]
            row = next(item.recordings[each.modality] for item in member.samples)
            for severity in (SEVERITIES[0], SEVERITIES[-1]):
                member.dataset.perturbed(row, each, severity)


def _run_trials(
    config: Config, systems: Sequence[System], chosen: Sequence[Perturbation], directory: Path
) -> tuple[list[Trial], Bench, list[Break]]:
    """All severities of all perturbations, then the search for breaking points between them."""
    record, settings = Record(directory / RECORD), config.stability
    pairs = [(system, each) for each in chosen for system in systems if system.meets(each)]
    severities = len(SEVERITIES) + 1
    total = len(pairs) * (severities + settings.bisections)
    with stage("trial", total, len(record.trials)) as level:
        bench, trials = Bench(systems, record), []
        for trial in bench.grid(chosen):
            trials.append(trial)
            level.update(len(trials), notes=[trial.perturbation.name])
        breaks = []
        for number, (system, each) in enumerate(pairs):
            level.update(
                len(trials) + number * settings.bisections,
                title="search for breaking points, trial", notes=[each.name],
            )  # fmt: skip
            found = bench.breaking_point(system, each, settings.bound, settings.bisections)
            breaks.append((system, each, found))
    return trials, bench, breaks


def _entries(bench: Bench, trials: Sequence[Trial], breaks: Sequence[Break]) -> dict[str, Any]:
    first = bench.systems[0]
    reference = mean_errors([trial for trial in trials if trial.system is first])
    entries = {}
    for system in bench.systems:
        own = [found for tested, _, found in breaks if tested is system]
        entries[system.name] = {
            **summarise_system(system, trials, reference),
            "breaks": sum(found.below is not None for found in own),
            **(conflict_summary(system, bench) if system.kind == FUSION else {}),
        }
    return entries


def _curves(trials: Sequence[Trial]) -> dict[str, list[tuple[str, int, float]]]:
    """Perturbation, severity and vote accuracy of each system."""
    curves: dict[str, list[tuple[str, int, float]]] = {}
    for trial in trials:
        title = f"{trial.perturbation.modality}/{trial.perturbation.name}"
        point = title, int(trial.severity), trial.accuracy
        curves.setdefault(trial.system.name, []).append(point)
    return curves
