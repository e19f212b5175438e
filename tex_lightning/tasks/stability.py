"""Find where systems fail: perturb their test recordings at increasing severity and vote."""

import time
from dataclasses import asdict
from typing import Any

from tex_lightning.config import Config, Job
from tex_lightning.core.files import write_rows
from tex_lightning.evaluation.robustness import StabilityRow, failure_entry, find_failures
from tex_lightning.report.figures import save_figure
from tex_lightning.report.stability_charts import print_stability, stability_figure
from tex_lightning.studies.load_systems import load_systems
from tex_lightning.studies.network_results import run_facts
from tex_lightning.studies.perturbed import choose_perturbations, run_trials, system_entry


def run(config: Config, job: Job) -> dict[str, Any]:
    """Test ``stability.systems`` under all perturbations that they meet; return the results."""
    begin, directory = time.perf_counter(), job.directory
    divided = any(map(job.sets, ("data.folds", "data.test_fold", "data.test_where")))
    systems = load_systems(config, choose=not divided)
    chosen = choose_perturbations(systems, config.stability)
    trials = run_trials(systems, chosen)
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
        "systems": {system.name: system_entry(system, trials) for system in systems},
        "failures": [failure_entry(failure, table) for failure in find_failures(trials)],
    }
    print_stability(results, directory)
    return results
