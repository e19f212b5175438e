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
from tex_lightning.errors import UserError
from tex_lightning.evaluation.conditions import pool_conditions
from tex_lightning.evaluation.novelty import pool_unknown
from tex_lightning.evaluation.outcomes import (
    Outcome,
    read_outcomes,
    summarise,
    write_outcomes,
    write_results,
)
from tex_lightning.learning.loggers import log_test
from tex_lightning.report.table import print_results, write_conditions
from tex_lightning.studies.console_summary import Opening, trained_networks
from tex_lightning.studies.dataset import Workspace, open_workspace
from tex_lightning.studies.evaluate_checkpoint import (
    calibration_metrics,
    draw_figures,
)
from tex_lightning.studies.fold import fit_fold, results_frame
from tex_lightning.studies.profile import profile_networks
from tex_lightning.studies.sample_maps import Tested, draw_explanations, drawn_rows

log = logging.getLogger(__name__)


def cross_validate(config: Config, job: Job) -> dict[str, Any]:
    """Run all folds, or those in ``crossval.only``; write ``results.json`` and return it."""
    chosen, directory = chosen_folds(config), job.directory
    opening = Opening(config.data, trained_networks(config.model), chosen)
    workspace = open_workspace(config, directory, opening)
    for fold in chosen:  # before time is spent on the first
        workspace.on_fold(fold, directory).parts()
    done = {fold: _finished_fold(workspace, fold) for fold in chosen}
    left = [fold for fold, results in done.items() if results is None]
    fresh = {fold: _run_fold(workspace, fold) for fold in steps(left, "fold")}
    folds = {fold: done[fold] or fresh[fold] for fold in chosen}
    if not is_rank_zero():
        return {}
    names = next(iter(folds.values()))["networks"]
    networks = {name: _pool(workspace, folds, name) for name in names}
    seconds = sum(results["wall_seconds"] for results in folds.values())
    results = results_frame(config.task, workspace, networks, seconds)
    if config.model.name in config.crossval.profile:
        _profile(config, networks[workspace.kind]["checkpoint"], job)
    write_conditions(networks, directory)
    write_results(directory / "results.json", results)
    print_results(results, directory)
    return results


def _profile(config: Config, checkpoint: str, job: Job) -> None:
    """Measure the network as task=profile does, once."""
    inside = replace(job, directory=job.directory / "profile")
    if not (inside.directory / "results.json").is_file():
        profile_networks(replace(config, task="profile", checkpoint=checkpoint), inside)


def _explain(
    workspace: Workspace,
    entries: Mapping[int, dict[str, Any]],
    by_fold: Mapping[int, Sequence[Outcome]],
) -> dict[str, Figure]:
    """Draw the worst samples of all folds, each by the network that tested it."""
    config = workspace.config
    places = [(fold, index) for fold, own in by_fold.items() for index in range(len(own))]
    outcomes = [by_fold[fold][index] for fold, index in places]
    rows = drawn_rows(outcomes, config.explained_samples)

    def tested() -> Iterator[Tested]:
        for fold, entry in entries.items():
            own = {row: places[row][1] for row in rows if places[row][0] == fold}
            checkpoint = Path(entry["checkpoint"])
            if own and not checkpoint.is_file():
                log.warning("Fold %d has no label maps: %s is gone.", fold, checkpoint)
            if not own or not checkpoint.is_file():
                continue
            classifier = load_classifier(checkpoint)
            test = workspace.on_fold(fold, _fold_directory(workspace, fold)).parts().test
            samples = make_samples(test, classifier.card.modalities)
            yield classifier, {row: samples[index] for row, index in own.items()}

    return draw_explanations(
        tested(),
        outcomes,
        workspace.store,
        config,
        workspace.kind,
        workspace.directory,
    )


def chosen_folds(config: Config) -> list[int]:
    """The folds that ``crossval.only`` asks for, or all.

    Raises:
        UserError: If one does not exist.
    """
    every = range(config.data.folds)
    chosen = list(every) if config.crossval.only is None else config.crossval.only
    wrong = [fold for fold in chosen if fold not in every]
    if wrong or not chosen:
        raise UserError(
            f"crossval.only={chosen} must name folds from 0 to {config.data.folds - 1}."
        )
    return sorted(set(chosen))


def _fold_directory(workspace: Workspace, fold: int) -> Path:
    return workspace.directory / "folds" / str(fold)


def _finished_fold(workspace: Workspace, fold: int) -> dict[str, Any] | None:
    """Results of a fold that an earlier run has finished, perhaps in a folder since moved."""
    directory = _fold_directory(workspace, fold)
    done = directory / "results.json"
    if not done.is_file():
        return None
    log.info("Fold %d is done already.", fold)
    results = read_record(done)
    for entry in results["networks"].values():
        here = directory / "checkpoints" / Path(entry["checkpoint"]).name
        if here.is_file():
            entry["checkpoint"] = str(here)
    return results


def _run_fold(workspace: Workspace, fold: int) -> dict[str, Any]:
    directory = _fold_directory(workspace, fold)
    begin = time.perf_counter()
    on_fold = workspace.on_fold(fold, directory)
    networks = fit_fold(on_fold)
    if not is_rank_zero():
        return {}
    results = results_frame("crossval", on_fold, networks, time.perf_counter() - begin)
    write_results(directory / "results.json", results)
    return results


def _pool(workspace: Workspace, folds: dict[int, dict[str, Any]], name: str) -> dict[str, Any]:
    """One network over all folds: counts pooled, sizes and checkpoint of the first fold."""
    entries = {fold: results["networks"][name] for fold, results in folds.items()}
    config, decision = workspace.config, workspace.config.decision
    by_fold = {
        fold: read_outcomes(_fold_directory(workspace, fold) / "predictions" / f"{name}.csv")
        for fold in folds
    }
    outcomes = [outcome for fold in by_fold.values() for outcome in fold]
    write_outcomes(outcomes, workspace.directory / "predictions" / f"{name}.csv")
    figures = draw_figures(outcomes, workspace.classes, name, workspace.directory)
    if name == workspace.kind:
        figures |= _explain(workspace, entries, by_fold)
    directories = [_fold_directory(workspace, fold) for fold in folds]
    first = next(iter(entries.values()))
    kept = ("fragment_accuracy", "vote_accuracy", "test_samples", "fit_seconds", "checkpoint")
    pooled = {
        **summarise(outcomes),
        **pool_conditions(entries.values()),
        **calibration_metrics(outcomes, decision.reject_below),
        **pool_unknown(
            dict(zip(directories, entries.values(), strict=True)),
            list(by_fold.values()),
            name,
            workspace.directory,
            decision.unknown,
        ),
        "parameters": first["parameters"],
        "macs_per_sample": first["macs_per_sample"],
        "fit_seconds": sum(entry["fit_seconds"] for entry in entries.values()),
        "checkpoint": first["checkpoint"],
        "folds": [
            {"fold": fold, **{key: entry[key] for key in kept}} for fold, entry in entries.items()
        ],
    }
    log_test(config.logger, workspace.directory, name, plain_values(config), pooled, figures)
    return pooled
