"""Train and test the networks of a model on one fold.

A task opens its data by :func:`open_and_show`, a program that shows nothing by
:func:`open_training`. :func:`train_model` then only trains. :func:`train_and_test` tests each
network, too, as soon as it is trained, and gives its entry of ``results.json``;
:func:`run_fold`, for one fold of several, writes that file (:func:`training_results`) beside it.
The networks are trained by :mod:`tex_lightning.learning.train`, and tested by
:mod:`.network_results`.
"""

import logging
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from tex_lightning.classifier.card import LABEL, Card, configured_card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, Folding, ModelConfig, plain_values, trunk_name
from tex_lightning.config.model import FUSION
from tex_lightning.core.devices import pick_device
from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.core.run_folder import read_results, write_results
from tex_lightning.data.folds import make_samples, split, tested_part
from tex_lightning.data.recordings import Recordings
from tex_lightning.errors import UserError
from tex_lightning.inference.prediction import name_conflict
from tex_lightning.learning.loggers import log_test
from tex_lightning.learning.provenance import note_recordings
from tex_lightning.learning.train import Training, train_networks
from tex_lightning.learning.training_check import check_custom_parts, check_training
from tex_lightning.networks.weights import NO_WEIGHTS, RANDOM
from tex_lightning.report.artifacts import Artifact
from tex_lightning.studies.dataset import Dataset, open_dataset
from tex_lightning.studies.description import show_opening
from tex_lightning.studies.network_results import (
    describe_network,
    log_network,
    report_network,
    results_frame,
)

log = logging.getLogger(__name__)


def open_and_show(config: Config, directory: Path, trains: Iterable[Folding]) -> Dataset:
    """Open the data set of one or several trainings, and print its description."""
    dataset, model = open_training(config, directory), config.model
    note_recordings([*dataset.recordings, *dataset.unknown], directory)
    parts = "" if model.baseline or model.kind != FUSION else f": {', '.join(model.trained)}"
    keep = directory if is_rank_zero() else None
    show_opening(config.data, dataset, f"{model.name}{parts}", trains=trains, keep_in=keep)
    return dataset


def open_training(config: Config, directory: Path) -> Dataset:
    """Check what a training is made of, and open its data set.

    Raises:
        UserError: If the data or the networks cannot be used.
    """
    senses = check_training(config, configured_card(config, ["one", "other"]), directory)
    dataset = open_dataset(config.data, senses)
    if config.decision.unknown and LABEL in dataset.classes:
        raise name_conflict("The data has")
    card = configured_card(config, dataset.classes)
    check_custom_parts(config, card, senses, dataset.recordings, dataset.store)
    return dataset.usable(senses, skip_bad=config.data.skip_bad)


def train_model(config: Config, dataset: Dataset, directory: Path) -> SurfaceClassifier:
    """Train a model on what :func:`open_training` gives, without testing it.

    FusionNet is preceded by its networks. With ``logger={}`` no metrics are written.

    Returns:
        The whole model, ready to classify on the CPU; its checkpoint is that of the directory.
    """
    parts = dataset.parts(config.data)
    trained = train_networks(config, dataset.classes, parts, dataset.store, directory)
    *_, (_, classifier) = trained
    return classifier


def run_fold(
    config: Config, dataset: Dataset, home: Path, *, shared: Path | None = None
) -> dict[str, Any]:
    """Train and test on one fold of several; write its ``results.json`` and return it.

    Arguments are those of :func:`train_and_test`. A process that is not rank zero has no results.
    """
    begin = time.perf_counter()
    networks = train_and_test(config, dataset, home, shared=shared)
    if not is_rank_zero():
        return {}
    results = training_results(config, dataset, networks, time.perf_counter() - begin)
    write_results(home, results)
    return results


def train_and_test(
    config: Config,
    dataset: Dataset,
    directory: Path,
    *,
    draw: bool = False,
    shared: Path | None = None,
    crossvalidated: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> dict[str, Any]:
    """Train and test all networks that the model consists of on one fold.

    Args:
        config: The model, and the fold.
        dataset: Recordings to train and test on.
        directory: Folder of checkpoints and predictions.
        draw: Whether figures are drawn; a cross-validation draws those of all folds together.
        shared: Folder with networks that several systems of a family have in common; those
            that a FusionNet takes from there are not tested.
        crossvalidated: By network the result of a cross-validation, for its card.

    Returns:
        By network its entry of ``results.json``.
    """
    parts, networks = dataset.parts(config.data), dict[str, Any]()
    trained = train_networks(
        config, dataset.classes, parts, dataset.store, directory,
        shared=shared, crossvalidated=crossvalidated,
    )  # fmt: skip
    for training, classifier in trained:
        name = classifier.card.kind
        networks[name] = {"fit_seconds": classifier.card.training.get("fit_seconds")}
        if is_rank_zero() and (name == config.model.kind or shared is None):  # it alone writes
            networks[name] = _test_network(training, classifier, dataset, networks, draw=draw)
    return networks


def _test_network(
    training: Training,
    classifier: SurfaceClassifier,
    dataset: Dataset,
    networks: Mapping[str, Any],
    *,
    draw: bool,
) -> dict[str, Any]:
    """Test a trained network, if there is a test part; return its entry of ``results.json``."""
    config, parts, store = training.config, training.parts, training.store
    directory, checkpoint = training.directory, training.checkpoint
    classifier.to(pick_device(config.trainer.accelerator))
    kind, modalities = classifier.card.kind, classifier.card.modalities
    further: Iterable[Artifact] = ()
    if make_samples(parts.test, modalities):
        unknown = split(dataset.unknown, config.data, trains=True).test
        tested = replace(dataset, recordings=parts.test, unknown=unknown)
        result, further = report_network(
            config, tested, classifier, checkpoint, directory, draw=draw
        )
    else:
        sample = make_samples(parts.train, modalities)[0]
        result = {"test_samples": 0, **describe_network(classifier, checkpoint, sample, store)}
    if draw:
        known, loggers = {**networks, kind: result}, training.loggers
        log_network(config, dataset.classes, directory, loggers, known, further, trained=True)
    else:
        log_test(training.loggers, kind, plain_values(config), result)
    _log_result(classifier.card, result, parts.train, config.data)
    return result


def _log_result(card: Card, result: Mapping[str, Any], train: Recordings, by: Folding) -> None:
    """Log in one line what came out of a training and its test, if there was one."""
    title, part = card.title, tested_part(by)
    if result["test_samples"]:
        log.info(
            "%s, %s: %d of %d samples correct, trained in %.1f s.",
            part[0].upper() + part[1:], title, result["correct"], result["test_samples"],
            result["fit_seconds"],
        )  # fmt: skip
    else:
        log.info(
            "%s: trained on %d recordings in %.1f s, and not tested.",
            title[0].upper() + title[1:], len(train.of(*card.modalities)), result["fit_seconds"],
        )  # fmt: skip


def training_results(
    config: Config, dataset: Dataset, networks: dict[str, Any], seconds: float
) -> dict[str, Any]:
    """Return ``results.json`` of a training, with the sources of first weights."""
    model, sources = config.model, {**config.sources, **config.model.checkpoints}
    weights = {name: sources.get(name, _first_weights(model, name)) for name in model.senses}
    baseline = model.baseline is not None
    frame = results_frame(config, model.name, dataset, networks, seconds, baseline=baseline)
    return {**frame, "weights": weights}


def _first_weights(model: ModelConfig, sense: str) -> str:
    """Return what a training without a source begins with: a fit has no weights but a trunk's."""
    fits = model.baseline is not None or not model.fit_values(sense)["epochs"]
    return NO_WEIGHTS if fits and trunk_name(model, sense) in (sense, "None") else RANDOM


def finished_results(home: Path, what: str) -> dict[str, Any]:
    """Return the results of a run or a fold, called ``what``, if it was finished earlier."""
    results = read_results(home)
    if results:
        log.info("%s is finished already.", what)
    return results


def chosen_folds(count: int, only: list[int] | None) -> list[int]:
    """Return the folds that ``crossval.only`` asks for, or all of ``count``.

    Raises:
        UserError: If one does not exist.
    """
    chosen = list(range(count)) if only is None else only
    if not chosen or any(fold not in range(count) for fold in chosen):
        raise UserError(f"crossval.only={chosen} must name folds from 0 to {count - 1}.")
    return sorted(set(chosen))
