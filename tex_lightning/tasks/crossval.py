"""Test every fold once with networks trained on all the others, and pool the counts.

A fold that is finished is never repeated: the same command with the same ``hydra.run.dir`` goes on
where the last one stopped, in the middle of a fold if need be. With ``crossval.refit`` the same is
trained on all recordings then: that network is the one to use, and its card has the figures of the
folds.
"""

import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.card import CROSSVAL
from tex_lightning.config import Config, Job
from tex_lightning.core.progress import track
from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.core.run_folder import checkpoint_of, predictions_of
from tex_lightning.evaluation.conditions import pool_conditions
from tex_lightning.evaluation.metrics import figures, metrics_in, pooled_metrics
from tex_lightning.evaluation.novelty import pool_unknown
from tex_lightning.evaluation.outcomes import COUNTS, read_outcomes, write_outcomes
from tex_lightning.learning.loggers import open_loggers
from tex_lightning.report.gallery import sample_artifacts
from tex_lightning.report.misclassified import keep_samples
from tex_lightning.report.samples import SampleView
from tex_lightning.report.table import print_results
from tex_lightning.studies.dataset import Dataset
from tex_lightning.studies.fold import (
    chosen_folds,
    finished_results,
    open_and_show,
    run_fold,
    train_and_test,
    training_results,
)
from tex_lightning.studies.network_results import draw_figures, fold_samples, log_network


def run(config: Config, job: Job) -> dict[str, Any]:
    """Run all folds, or those in ``crossval.only``, and return the pooled results."""
    refits = config.crossval.refit
    chosen = chosen_folds(config.data.folds, config.crossval.only)
    whole = config.on_fold(None)
    divisions = [config.on_fold(fold).data for fold in chosen] + [whole.data] * refits
    dataset = open_and_show(config, job.directory, divisions)
    for division in divisions:  # before time is spent on the first
        dataset.parts(division)
    folds: dict[Path, dict[str, Any]] = {}
    for fold in track(chosen, "fold"):
        home = job.directory / "folds" / str(fold)
        folds[home] = finished_results(home, f"Fold {fold}") or run_fold(
            config.on_fold(fold), dataset, home
        )
    pooled: dict[str, Any] = {}
    for name in next(iter(folds.values()))["networks"] if is_rank_zero() else ():
        pooled[name] = _pool(config, dataset, job.directory, folds, name)
    begin = time.perf_counter()
    refitted = _refit(whole, dataset, job.directory, pooled) if refits else {}
    spent = time.perf_counter() - begin
    if not is_rank_zero():
        return {}
    networks: dict[str, Any] = {}
    for name, entry in pooled.items():
        networks[name] = {**entry, **refitted.get(name, {})}
        _draw_and_log(config, dataset, job.directory, networks, folds)
    seconds = spent + sum(results["wall_seconds"] for results in folds.values())
    results = training_results(config, dataset, networks, seconds)
    print_results(results, job.directory)
    return results


def _draw_and_log(
    config: Config,
    dataset: Dataset,
    directory: Path,
    networks: Mapping[str, Any],
    homes: Iterable[Path],
) -> None:
    """Draw and log the last of some networks, its samples by the network of their fold."""
    *_, name = networks
    loggers = open_loggers(config.logger, directory, name)
    files = {home.name: checkpoint_of(home, name) for home in homes}
    load = lru_cache(maxsize=2)(load_classifier)
    outcomes = read_outcomes(predictions_of(directory, name))
    samples = fold_samples(dataset, outcomes)
    view = SampleView(
        lambda outcome: load(files[outcome.fold]), dataset.classes, samples, outcomes, dataset.store
    )
    keep_samples(directory, name, view)
    further = sample_artifacts(view)
    log_network(config, dataset.classes, directory, loggers, networks, further, trained=True)


def _refit(
    config: Config, dataset: Dataset, directory: Path, pooled: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Train the networks on all recordings, and keep on their cards what the folds have given.

    Returns:
        By network what changes in its entry: the checkpoint, and the time of this training.
    """
    known = {
        name: {**{key: entry[key] for key in COUNTS}, "folds": len(entry["folds"])}
        for name, entry in pooled.items()
    }
    networks = train_and_test(config, dataset, directory, crossvalidated=known)
    for name, entry in networks.items() if is_rank_zero() else ():
        if entry[CROSSVAL] != known[name]:  # more folds were tested since it was trained
            classifier = load_classifier(path := checkpoint_of(directory, name))
            training = {**classifier.card.training, CROSSVAL: known[name]}
            classifier.card = replace(classifier.card, training=training)
            classifier.save(path)
    return {
        name: {"checkpoint": entry.get("checkpoint"), "refit_seconds": entry["fit_seconds"]}
        for name, entry in networks.items()
    }


def _pool(
    config: Config, dataset: Dataset, directory: Path, folds: dict[Path, dict[str, Any]], name: str
) -> dict[str, Any]:
    """Pool one network over all folds: counts of all, sizes and checkpoint of the first."""
    entries = {home: results["networks"][name] for home, results in folds.items()}
    first = next(iter(entries.values()))
    by_fold = [read_outcomes(predictions_of(home, name)) for home in folds]
    outcomes = [outcome for fold in by_fold for outcome in fold]
    write_outcomes(outcomes, predictions_of(directory, name))
    draw_figures(outcomes, dataset.classes, name, directory)
    return {
        **pooled_metrics(outcomes),
        **pool_conditions(entries.values()),
        **pool_unknown(entries, by_fold, name, directory, config.decision.unknown),
        "parameters": first["parameters"],
        "macs_per_sample": first["macs_per_sample"],
        "fit_seconds": sum(entry["fit_seconds"] for entry in entries.values()),
        "checkpoint": first["checkpoint"],
        "folds": [
            {
                "fold": int(home.name),
                **figures(entry, metrics_in("folds")),
                "checkpoint": entry["checkpoint"],
            }
            for home, entry in entries.items()
        ],
    }
