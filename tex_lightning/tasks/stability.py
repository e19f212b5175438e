"""Find where systems fail: perturb their test recordings at increasing severity and vote."""

import json
import logging
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import fmean
from typing import Any

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.config.keys import choice
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import write_text
from tex_lightning.core.progress import stage, track
from tex_lightning.data.store import skipped_entry
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import environment, wilson_interval, write_results
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
    BreakRow,
    StabilityRow,
    print_stability,
    stability_figures,
    write_breaks,
    write_trials,
)
from tex_lightning.studies.perturbed import Labels, PerturbedSystem
from tex_lightning.studies.systems import load_systems

RECORD = "trials.jsonl"

log = logging.getLogger(__name__)


class Trials:
    """Labels of systems under perturbations, kept on disk: a run that was stopped goes on.

    Args:
        systems: What is tested.
        path: A JSON line per trial; what it holds already is read, but for a line that is cut off.

    Raises:
        UserError: If a line is damaged.
    """

    def __init__(self, systems: Sequence[PerturbedSystem], path: Path) -> None:
        self.path = path
        self.labels: dict[tuple[str, str, float], Labels] = {}
        lines = path.read_text(encoding="utf-8").splitlines(True) if path.is_file() else []
        whole = [line for line in lines if line.endswith("\n")]
        try:
            for line in whole:
                system, perturbation, severity, labels = json.loads(line)
                self.labels[system, perturbation, severity] = labels
        except (TypeError, ValueError) as error:
            raise UserError(
                f"{path} is damaged; delete it and run the same command again."
            ) from error
        write_text(path, "".join(whole))
        self.clean = {each.name: each.decide() for each in track(systems, "recordings as they are")}

    def row(
        self, system: PerturbedSystem, perturbation: Perturbation, severity: float
    ) -> StabilityRow:
        """Run a trial, unless it was; a sample that is refused counts as wrong."""
        key, clean = (system.name, perturbation.name, severity), self.clean[system.name]
        labels = clean if severity == 0 else self.labels.get(key)
        if labels is None:
            labels = self.labels[key] = system.decide(perturbation, severity)
            with self.path.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps([*key, labels]) + "\n")
        count = len(clean)
        correct = sum(found == truth for found, truth in zip(labels, system.labels, strict=True))
        flips = sum(found != before for found, before in zip(labels, clean, strict=True))
        low, high = wilson_interval(correct, count)
        return StabilityRow(
            system.name, perturbation.modality, perturbation.name, severity, count,
            correct / count, low, high, flips / count,
        )  # fmt: skip

    def breaking_point(
        self, system: PerturbedSystem, perturbation: Perturbation, bound: float, steps: int
    ) -> BreakRow:
        """Find the mildest severity below the bound.

        The first whole severity below it is taken, and the stretch before that bisected; an
        accuracy that recovers later does not count.

        Args:
            system: One that meets the perturbation.
            perturbation: The perturbation.
            bound: Share of the clean vote accuracy that has to be kept.
            steps: Bisections of the stretch.
        """
        clean = self.row(system, perturbation, 0).vote_accuracy
        least = bound * clean
        head = (system.name, perturbation.modality, perturbation.name, perturbation.unit)
        trials = (self.row(system, perturbation, severity) for severity in SEVERITIES)
        below = next((trial for trial in trials if trial.vote_accuracy < least), None)
        if below is None:
            return BreakRow(*head, clean, least)
        kept = below.severity - 1
        for _ in range(steps):
            middle = self.row(system, perturbation, (kept + below.severity) / 2)
            if middle.vote_accuracy < least:
                below = middle
            else:
                kept = middle.severity
        value = perturbation.value(below.severity)
        return BreakRow(*head, clean, least, "true", below.severity, value, below.vote_accuracy)


def run(config: Config, job: Job) -> dict[str, Any]:
    """Test ``stability.systems`` under all perturbations that they meet; return the results.

    A run that was stopped goes on with the same command and ``hydra.run.dir``.
    """
    begin, directory = time.perf_counter(), job.directory
    systems = load_systems(config)
    chosen = _chosen(config, systems)
    _try_own(chosen, systems)
    trials, breaks = _run_trials(config, systems, chosen, directory)
    write_trials(trials, directory)
    write_breaks(breaks, directory)
    figures = stability_figures(trials, {each.name: each for each in chosen})
    for title, figure in figures.items():
        save_figure(figure, directory / "figures" / title)
    log_stability(config.logger, directory, _curves(trials), figures)
    skipped = {each: None for system in systems for fold in system.folds for each in fold.skipped}
    results = {
        "task": config.task,
        "data": config.data.name,
        "seed": config.seed,
        "wall_seconds": time.perf_counter() - begin,
        "environment": environment(pick_device(config.trainer.accelerator)),
        "engine": asdict(config.engine),
        "bound": config.stability.bound,
        "perturbations": {each.name: asdict(each) for each in chosen},
        "skipped": skipped_entry(skipped),
        "systems": {system.name: _entry(system, trials, breaks) for system in systems},
    }
    write_results(directory / "results.json", results)
    print_stability(results, directory)
    return results


def _chosen(config: Config, systems: Sequence[PerturbedSystem]) -> list[Perturbation]:
    """Those asked for that some system meets."""
    known, only = dict(perturbations()), config.stability.only
    for system in systems:
        for branch in system.folds[0].classifier.senses.values():
            if branch.medium == "signal":
                known |= signal_perturbations(branch.modality)
    for path in config.stability.severities:
        known |= read_severities(path)
    for name in only or ():
        if complaint := next(choice("stability.only", name, tuple(known)), None):
            raise UserError(f"{complaint}.")
    asked = list(known.values()) if only is None else [known[name] for name in only]
    chosen = [each for each in asked if any(system.meets(each) for system in systems)]
    left_out = ", ".join(each.name for each in asked if each not in chosen)
    if not chosen:
        raise UserError(f"No system meets {left_out}; choose other stability.only or systems.")
    if left_out:
        log.debug("Perturbations that no system meets are left out: %s.", left_out)
    return chosen


def _try_own(chosen: Sequence[Perturbation], systems: Sequence[PerturbedSystem]) -> None:
    """Apply every function of the user's to one recording, before time is spent."""
    for each in chosen:
        if each.is_users and each.modality != BOTH:
            fold = next(system for system in systems if system.meets(each)).folds[0]
            row = fold.samples[0].recordings[each.modality]
            for severity in (SEVERITIES[0], SEVERITIES[-1]):
                fold.datasets[each.modality].perturbed(row, each, severity)


def _run_trials(
    config: Config,
    systems: Sequence[PerturbedSystem],
    chosen: Sequence[Perturbation],
    directory: Path,
) -> tuple[list[StabilityRow], list[BreakRow]]:
    """All severities of all perturbations, then the search for breaking points between them."""
    settings = config.stability
    met = {each: [system for system in systems if system.meets(each)] for each in chosen}
    pairs = [(system, each) for each, own in met.items() for system in own]
    trials, rows, breaks = Trials(systems, directory / RECORD), [], []
    with stage("trial", len(pairs) * (len(SEVERITIES) + 1 + settings.bisections)) as level:
        for each, own in met.items():
            for severity in (0, *SEVERITIES):  # what was perturbed serves all systems
                rows += [trials.row(system, each, severity) for system in own]
                level.update(len(rows), notes=[each.name])
        for number, (system, each) in enumerate(pairs):
            level.update(len(rows) + number * settings.bisections, notes=[each.name])
            breaks.append(trials.breaking_point(system, each, settings.bound, settings.bisections))
    return rows, breaks


def _entry(
    system: PerturbedSystem, trials: Sequence[StabilityRow], breaks: Sequence[BreakRow]
) -> dict[str, Any]:
    """The entry of one system in ``results.json``."""
    own = [trial for trial in trials if trial.system == system.name]
    entry: dict[str, Any] = {
        "kind": system.kind,
        "checkpoints": [str(fold.checkpoint) for fold in system.folds],
    }
    if not own:
        return entry
    harmed, clean = [trial for trial in own if trial.severity > 0], own[0]
    errors = {
        name: fmean(1 - trial.vote_accuracy for trial in harmed if trial.perturbation == name)
        for name in dict.fromkeys(trial.perturbation for trial in harmed)
    }
    return {
        **entry,
        "perturbations": len(errors),
        "breaks": sum(each.reached == "true" for each in breaks if each.system == system.name),
        "clean": {
            "vote_accuracy": clean.vote_accuracy,
            "vote_ci95": [clean.ci_low, clean.ci_high],
            "correct": round(clean.vote_accuracy * clean.test_samples),
            "test_samples": clean.test_samples,
        },
        "mean_error": fmean(errors.values()),
        "mean_flip_rate": fmean(trial.flip_rate for trial in harmed),
        "perturbation_errors": errors,
    }


def _curves(trials: Sequence[StabilityRow]) -> dict[str, list[tuple[str, int, float]]]:
    """Perturbation, severity and vote accuracy of each system."""
    curves: dict[str, list[tuple[str, int, float]]] = {}
    for trial in trials:
        title = f"{trial.modality}/{trial.perturbation}"
        point = title, int(trial.severity), trial.vote_accuracy
        curves.setdefault(trial.system, []).append(point)
    return curves
