"""Test every fold once with networks trained on all the others, and pool the counts.

A fold that is finished is never repeated: the same command with the same ``hydra.run.dir`` goes on
where the last one stopped, in the middle of a fold if need be.
"""

import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config, plain_values
from tex_lightning.config.composition import Job
from tex_lightning.core.files import read_record
from tex_lightning.core.progress import steps
from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.data.folds import make_samples
from tex_lightning.evaluation.conditions import pool_conditions
from tex_lightning.evaluation.novelty import pool_unknown
from tex_lightning.evaluation.outcomes import (
    Outcome,
    read_outcomes,
    write_outcomes,
    write_results,
)
from tex_lightning.learning.loggers import log_test
from tex_lightning.report.table import print_results, write_conditions
from tex_lightning.studies.dataset import Dataset
from tex_lightning.studies.evaluate_checkpoint import draw_figures, pooled_metrics
from tex_lightning.studies.fold import chosen_folds, fit_fold, open_announced, training_results
from tex_lightning.studies.sample_maps import Tested, draw_explanations, drawn_rows
from tex_lightning.tasks import profile

log = logging.getLogger(__name__)
KEPT = ("fragment_accuracy", "vote_accuracy", "test_samples", "fit_seconds", "checkpoint")


def run(config: Config, job: Job) -> dict[str, Any]:
    """Run all folds, or those in ``crossval.only``; write ``results.json`` and return it."""
    chosen, directory = chosen_folds(config), job.directory
    dataset = open_announced(config, directory)
    for fold in chosen:  # before time is spent on the first
        dataset.on_fold(fold).parts()
    done = {fold: _finished_fold(_home(directory, fold)) for fold in chosen}
    left = [fold for fold, results in done.items() if results is None]
    fresh = {fold: _run_fold(dataset, fold, _home(directory, fold)) for fold in steps(left, "fold")}
    folds = {fold: done[fold] or fresh[fold] for fold in chosen}
    if not is_rank_zero():
        return {}
    names = next(iter(folds.values()))["networks"]
    networks = {name: _pool(dataset, directory, folds, name) for name in names}
    seconds = sum(results["wall_seconds"] for results in folds.values())
    results = training_results(dataset, networks, seconds)
    if config.model.name in config.crossval.profile:
        _profile(config, networks[config.model.kind]["checkpoint"], job)
    write_conditions(networks, directory)
    write_results(directory / "results.json", results)
    print_results(results, directory)
    return results


def _profile(config: Config, checkpoint: str, job: Job) -> None:
    """Measure the network as task=profile does, once."""
    inside = replace(job, directory=job.directory / "profile")
    if not (inside.directory / "results.json").is_file():
        profile.run(replace(config, task="profile", checkpoint=checkpoint), inside)


def _home(directory: Path, fold: int) -> Path:
    return directory / "folds" / str(fold)


def _finished_fold(home: Path) -> dict[str, Any] | None:
    """Results of a fold that an earlier run has finished, perhaps in a folder since moved."""
    if not (home / "results.json").is_file():
        return None
    log.info("Fold %s is done already.", home.name)
    results = read_record(home / "results.json")
    for entry in results["networks"].values():
        here = home / "checkpoints" / Path(entry["checkpoint"]).name
        if here.is_file():
            entry["checkpoint"] = str(here)
    return results


def _run_fold(dataset: Dataset, fold: int, home: Path) -> dict[str, Any]:
    begin, on_fold = time.perf_counter(), dataset.on_fold(fold)
    networks = fit_fold(on_fold, home)
    if not is_rank_zero():
        return {}
    results = training_results(on_fold, networks, time.perf_counter() - begin)
    write_results(home / "results.json", results)
    return results


def _pool(
    dataset: Dataset, directory: Path, folds: dict[int, dict[str, Any]], name: str
) -> dict[str, Any]:
    """One network over all folds: counts pooled, sizes and checkpoint of the first fold."""
    entries = {fold: results["networks"][name] for fold, results in folds.items()}
    config, decision = dataset.config, dataset.config.decision
    homes = {fold: _home(directory, fold) for fold in folds}
    by_fold = {
        fold: read_outcomes(home / "predictions" / f"{name}.csv") for fold, home in homes.items()
    }
    outcomes = [outcome for fold in by_fold.values() for outcome in fold]
    write_outcomes(outcomes, directory / "predictions" / f"{name}.csv")
    figures = draw_figures(outcomes, dataset.classes, name, directory)
    if name == config.model.kind:
        figures |= _explain(dataset, directory, entries, by_fold)
    first = next(iter(entries.values()))
    tested = {homes[fold]: entry for fold, entry in entries.items()}
    pooled = {
        **pooled_metrics(outcomes, decision.reject_below),
        **pool_conditions(entries.values()),
        **pool_unknown(tested, list(by_fold.values()), name, directory, decision.unknown),
        "parameters": first["parameters"],
        "macs_per_sample": first["macs_per_sample"],
        "fit_seconds": sum(entry["fit_seconds"] for entry in entries.values()),
        "checkpoint": first["checkpoint"],
        "folds": [
            {"fold": fold, **{key: entry[key] for key in KEPT}} for fold, entry in entries.items()
        ],
    }
    log_test(config.logger, directory, name, plain_values(config), pooled, figures)
    return pooled


def _explain(
    dataset: Dataset,
    directory: Path,
    entries: Mapping[int, dict[str, Any]],
    by_fold: Mapping[int, Sequence[Outcome]],
) -> dict[str, Figure]:
    """Draw the worst samples of all folds, each by the network that tested it."""
    config = dataset.config
    places = [(fold, index) for fold, own in by_fold.items() for index in range(len(own))]
    outcomes = [by_fold[fold][index] for fold, index in places]
    rows = drawn_rows(outcomes, config.explained_samples)

    def tested() -> Iterator[Tested]:
        for fold, entry in entries.items():
            own = {row: places[row][1] for row in rows if places[row][0] == fold}
            checkpoint = Path(entry["checkpoint"])
            if own and not checkpoint.is_file():
                log.warning("Fold %d has no label maps: %s is gone.", fold, checkpoint)
            elif own:
                classifier = load_classifier(checkpoint)
                test = dataset.on_fold(fold).parts().test
                samples = make_samples(test, classifier.card.modalities)
                yield classifier, {row: samples[index] for row, index in own.items()}

    return draw_explanations(
        tested(), outcomes, dataset.store, config, config.model.kind, directory
    )
