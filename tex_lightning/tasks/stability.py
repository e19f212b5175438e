"""Find where systems fail: perturb their test recordings at increasing severity and vote."""

import time
from collections.abc import Sequence
from dataclasses import asdict
from statistics import fmean
from typing import Any

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.files import write_rows
from tex_lightning.core.progress import Stage
from tex_lightning.evaluation.outcomes import counted, run_facts
from tex_lightning.evaluation.robustness import StabilityRow, failure_entry, find_failures
from tex_lightning.perturbations.table import SEVERITIES, Perturbation
from tex_lightning.report.figures import save_figure
from tex_lightning.report.stability_charts import print_stability, stability_figure
from tex_lightning.studies.perturbed import (
    PerturbedSystem,
    choose_perturbations,
    load_systems,
    run_trial,
)


def run(config: Config, job: Job) -> dict[str, Any]:
    """Test ``stability.systems`` under all perturbations that they meet; return the results."""
    begin, directory = time.perf_counter(), job.directory
    divided = any(map(job.sets, ("data.folds", "data.test_fold", "data.test_where")))
    systems = load_systems(config, choose=not divided)
    chosen = choose_perturbations(systems, config.stability)
    trials = _run_trials(systems, chosen)
    write_rows(directory / "stability.csv", StabilityRow._fields, trials)
    table = {perturbation.name: perturbation for perturbation in chosen}
    named = dict.fromkeys(trial.system for trial in trials)
    shown = {system.name: system.label for system in systems if system.name in named}
    chances = {system.name: system.chance for system in systems}
    figure = stability_figure(trials, table, shown, chances)
    save_figure(figure, directory / "figures" / "stability")
    baselines = [bool(fold.classifier.card.baseline) for it in systems for fold in it.folds]
    results = {
        **run_facts(config, time.perf_counter() - begin, baselines),
        "engine": asdict(config.engine),
        "perturbations": {perturbation.name: asdict(perturbation) for perturbation in chosen},
        "systems": {system.name: _entry(system, trials) for system in systems},
        "failures": [failure_entry(failure, table) for failure in find_failures(trials)],
    }
    print_stability(results, directory)
    return results


def _run_trials(
    systems: Sequence[PerturbedSystem], chosen: Sequence[Perturbation]
) -> list[StabilityRow]:
    """Run all severities of all perturbations."""
    trials = []
    with Stage("perturbation", len(chosen)) as level:
        for number, perturbation in enumerate(chosen):
            level.update(number, notes=[perturbation.name])
            affected = [system for system in systems if system.meets(perturbation)]
            for severity in (0, *SEVERITIES):  # a perturbed recording serves all systems
                trials += [run_trial(system, perturbation, severity) for system in affected]
    return trials


def _entry(system: PerturbedSystem, trials: Sequence[StabilityRow]) -> dict[str, Any]:
    """Return the entry of one system in ``results.json``."""
    rows = [trial for trial in trials if trial.system == system.name]
    entry: dict[str, Any] = {
        "name": system.label,
        "kind": system.kind,
        "chance": system.chance,
        "checkpoints": [str(fold.checkpoint) for fold in system.folds],
    }
    if not rows:
        return entry
    perturbed, clean = [trial for trial in rows if trial.severity > 0], rows[0]
    return {
        **entry,
        "clean": counted(round(clean.vote_accuracy * clean.test_samples), clean.test_samples),
        "mean_error": fmean(1 - trial.vote_accuracy for trial in perturbed),
        "mean_flip_rate": fmean(trial.flip_rate for trial in perturbed),
    }
