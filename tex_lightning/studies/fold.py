"""Train and test all networks of a model on one fold."""

import inspect
import logging
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tex_lightning.baselines.classifier import BaselineClassifier, Loaded, as_part, load_trained
from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import Trained
from tex_lightning.config import Config, plain_values
from tex_lightning.config.model import FUSION
from tex_lightning.core.console import log_once
from tex_lightning.core.contract import calling
from tex_lightning.core.devices import pick_device
from tex_lightning.core.progress import track
from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.data.folds import Split, make_samples
from tex_lightning.data.recordings import class_indices
from tex_lightning.data.store import load_recording
from tex_lightning.errors import UserError
from tex_lightning.evaluation.calibration import calibrated_card
from tex_lightning.evaluation.outcomes import RANDOM
from tex_lightning.learning.loggers import log_test
from tex_lightning.learning.start import name_source
from tex_lightning.learning.train import checkpoint_of, train_network, train_once
from tex_lightning.learning.trial import try_baseline
from tex_lightning.studies.dataset import (
    Dataset,
    given_start,
    make_card,
    open_dataset,
    show_opening,
)
from tex_lightning.studies.evaluate_checkpoint import (
    draw_figures,
    draw_worst,
    report_network,
    results_frame,
)

log = logging.getLogger(__name__)


def fit_baseline(dataset: Dataset, card: Card, parts: Split, directory: Path) -> Trained:
    """Fit, calibrate and write the checkpoint, unless it is there already.

    Args:
        dataset: On its fold.
        card: Card of the baseline.
        parts: Recordings by part.
        directory: The run folder.

    Raises:
        UserError: If a recording is too short, weights do not fit, or a user's class does not
            keep its contract.
    """
    config, store = dataset.config, dataset.store
    final, weights = checkpoint_of(directory, card.kind), config.baseline_weights
    if final.is_file():
        log.info("%s is fitted already.", final)
        return load_trained(final)
    rows = parts.train.of(card.modalities[0]).rows
    labels = np.array(class_indices([row.label for row in rows], card.classes))
    classifier = BaselineClassifier(card)
    if weights is not None:
        log_once(log, classifier.baseline.load_weights(weights))
    log.info("Fitting %s to %d recordings.", card.title, len(rows))
    begin = time.perf_counter()
    recordings = Loaded(rows, store, classifier.senses[card.kind])
    with calling(*as_part(classifier.baseline)):
        fit: Any = classifier.baseline.fit
        groups = [row.group_key for row in rows]
        more = {"groups": groups} if "groups" in inspect.signature(fit).parameters else {}
        fit(recordings, labels, config.seed, **more)
    seconds = time.perf_counter() - begin
    try_baseline(classifier, [load_recording(row, store) for row in rows[:2]])
    validation = make_samples(parts.val, card.modalities)
    classifier.card = calibrated_card(classifier, validation, store, config.decision, config.engine)
    classifier.save(final, seconds)
    return Trained(classifier, final, seconds)


def open_announced(config: Config, directory: Path) -> Dataset:
    """Open the data set of a training, and show it."""
    dataset, model = open_dataset(config, directory), config.model
    parts = "" if model.baseline or model.kind != FUSION else f": {', '.join(model.trained)}"
    show_opening(config, dataset, f"{model.name}{parts}")
    return dataset


def chosen_folds(count: int, only: list[int] | None) -> list[int]:
    """Return the folds that ``crossval.only`` asks for, or all of ``count``.

    Raises:
        UserError: If one does not exist.
    """
    chosen = list(range(count)) if only is None else only
    if not chosen or any(fold not in range(count) for fold in chosen):
        raise UserError(f"crossval.only={chosen} must name folds from 0 to {count - 1}.")
    return sorted(set(chosen))


def training_results(dataset: Dataset, networks: dict[str, Any], seconds: float) -> dict[str, Any]:
    """``results.json`` of a training, with the source of each network's or trunk's weights."""
    config = dataset.config
    given = {
        name: config.model.checkpoints.get(name) or config.weights_of(name)
        for name in config.model.senses
    }
    weights = {name: RANDOM if path is None else name_source(path) for name, path in given.items()}
    frame = results_frame(
        config, config.model.name, dataset.classes, dataset.skipped, networks, seconds
    )
    return {**frame, "weights": weights}


def fit_fold(
    dataset: Dataset,
    directory: Path,
    *,
    draw: bool = False,
    test_parts: bool = True,
    networks_in: Path | None = None,
) -> dict[str, Any]:
    """Train and test all networks that the model consists of on one fold.

    Args:
        dataset: On its fold.
        directory: Holds checkpoints and predictions.
        draw: Whether figures are drawn; of several folds they are drawn of all together.
        test_parts: Whether the networks that a FusionNet consists of are tested, too.
        networks_in: Folder in which systems of a family find networks that they have in common.

    Returns:
        By network its entry of ``results.json``.
    """
    parts, model = dataset.parts(), dataset.config.model
    unimodal: dict[str, Trained] = {}
    networks: dict[str, Any] = {}
    if model.kind == FUSION:  # before time is spent on the other networks
        given = model.checkpoints.items()
        unimodal = {name: given_start(dataset, name, Path(path)) for name, path in given}
    test = partial(_test_network, dataset, parts, directory, draw=draw)
    for name in track(model.trained, str):
        whole = name == model.kind
        senses = model.senses if whole else [name]
        starts = {sense: unimodal[sense] for sense in senses if whole and sense in unimodal}
        card = make_card(dataset, senses, starts)
        inputs = dataset.config, card, parts, dataset.store, directory, starts
        if card.baseline:
            trained = fit_baseline(dataset, card, parts, directory)
        elif networks_in is not None:
            trained = train_once(*inputs, networks_in)
        else:
            trained = train_network(*inputs)
        if not whole:
            unimodal[name] = trained
        networks[name] = {
            "checkpoint": str(trained.checkpoint),
            "fit_seconds": trained.fit_seconds,
        }
        if is_rank_zero() and (whole or test_parts):  # it alone tests and writes
            networks[name] = test(trained)
    return networks


def _test_network(
    dataset: Dataset, parts: Split, directory: Path, trained: Trained, *, draw: bool
) -> dict[str, Any]:
    """Test a trained network; its entry of ``results.json``."""
    config, classifier = dataset.config, trained.classifier
    classifier.to(pick_device(config.trainer.accelerator))
    kind, modalities = classifier.card.kind, classifier.card.modalities
    samples, unknown = make_samples(parts.test, modalities), dataset.unknown_samples(modalities)
    result, outcomes = report_network(trained, samples, dataset.store, directory, config, unknown)
    if draw:
        draw_figures(outcomes, dataset.classes, kind, directory)
    if draw and kind == config.model.kind:
        draw_worst(classifier, samples, outcomes, dataset.store, config, directory)
    log_test(config.logger, directory, kind, plain_values(config), result)
    log.info(
        "Fold %s, %s: %d of %d votes correct, trained in %.1f s.",
        config.data.test_fold, classifier.card.title, result["correct"], result["test_samples"],
        result["fit_seconds"],
    )  # fmt: skip
    return result
