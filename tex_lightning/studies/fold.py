"""Train and test all networks of a model on one fold."""

import inspect
import logging
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tex_lightning.baselines.classifier import (
    BaselineClassifier,
    Loaded,
    as_part,
    load_trained,
)
from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import Trained
from tex_lightning.config import Config, plain_values
from tex_lightning.config.instantiation import named_classes, trust
from tex_lightning.config.model import FUSION
from tex_lightning.core.console import log_once
from tex_lightning.core.contract import calling
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import suppress_thread_errors
from tex_lightning.core.progress import steps
from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.data.folds import Split, make_samples
from tex_lightning.data.recordings import class_indices
from tex_lightning.data.store import skipped_entry
from tex_lightning.evaluation.calibration import calibrated_card
from tex_lightning.evaluation.outcomes import RANDOM, environment
from tex_lightning.learning.inputs import InputData
from tex_lightning.learning.loggers import log_test
from tex_lightning.learning.start import name_source
from tex_lightning.learning.train import checkpoint_of, input_data, train_network, train_once
from tex_lightning.learning.trial import try_baseline
from tex_lightning.studies.console_summary import Opening, trained_networks
from tex_lightning.studies.dataset import (
    Workspace,
    configured_card,
    given_start,
    make_card,
    open_workspace,
)
from tex_lightning.studies.evaluate_checkpoint import draw_figures, report_network
from tex_lightning.studies.sample_maps import draw_telling

log = logging.getLogger(__name__)


def fit_baseline(workspace: Workspace, card: Card, parts: Split) -> Trained:
    """Fit, calibrate and write the checkpoint, unless it is there already.

    Args:
        workspace: Opened, on its fold.
        card: Card of the baseline.
        parts: Recordings by part.

    Raises:
        UserError: If a recording is too short, weights do not fit, or a user's class does not
            keep its contract.
    """
    config, store = workspace.config, workspace.store
    final, weights = checkpoint_of(workspace.directory, card.kind), config.baseline_weights
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
    try_baseline(classifier, recordings)
    validation = make_samples(parts.val, card.modalities)
    classifier.card = calibrated_card(classifier, validation, store, config)
    classifier.save(final, seconds)
    return Trained(classifier, final, seconds)


def results_frame(
    task: str, workspace: Workspace, networks: dict[str, Any], seconds: float
) -> dict[str, Any]:
    """The entries of every training task's ``results.json`` around its networks."""
    config = workspace.config
    return {
        "task": task,
        "model": config.model.name,
        "data": workspace.data.name,
        "classes": workspace.classes,
        "weights": weights(config),
        "seed": config.seed,
        "wall_seconds": seconds,
        "skipped": skipped_entry(workspace.skipped),
        "environment": environment(pick_device(config.trainer.accelerator)),
        "networks": networks,
    }


def weights(config: Config) -> dict[str, str]:
    """Source of the weights of its network, or of its trunk, by sense."""
    given = {
        name: config.model.checkpoints.get(name) or config.weights_of(name)
        for name in config.model.senses
    }
    return {name: RANDOM if path is None else name_source(path) for name, path in given.items()}


def fit_fold(
    workspace: Workspace,
    *,
    draw: bool = False,
    test_parts: bool = True,
    networks_in: Path | None = None,
) -> dict[str, Any]:
    """Train and test all networks that the model consists of on one fold.

    Args:
        workspace: Opened, on its fold.
        draw: Whether figures are drawn; of several folds they are drawn of all together.
        test_parts: Whether the networks that a FusionNet consists of are tested, too.
        networks_in: Folder in which systems of a family find networks that they have in common.

    Returns:
        By network its entry of ``results.json``.
    """
    parts, model = workspace.parts(), workspace.config.model
    unimodal: dict[str, Trained] = {}
    networks: dict[str, Any] = {}
    if workspace.kind == FUSION:
        # before time is spent on the other networks
        given = model.checkpoints.items()
        unimodal = {name: given_start(workspace, name, Path(path)) for name, path in given}
    fit = partial(_fit_network, workspace, parts, networks_in, draw=draw)
    for name in steps(model.trained, str):
        if name != workspace.kind:
            unimodal[name], networks[name] = fit([name], {}, test=test_parts)
        else:
            ordered = {sense: unimodal[sense] for sense in model.senses if sense in unimodal}
            _, networks[name] = fit(model.senses, ordered)
    return networks


def _fit_network(
    workspace: Workspace,
    parts: Split,
    networks_in: Path | None,
    senses: Sequence[str],
    unimodal: dict[str, Trained],
    *,
    draw: bool,
    test: bool = True,
) -> tuple[Trained, dict[str, Any]]:
    card = make_card(workspace, senses, unimodal)
    given = workspace.config, card, parts, workspace.store, workspace.directory, unimodal
    if card.baseline:
        trained = fit_baseline(workspace, card, parts)
    elif networks_in is not None:
        trained = train_once(*given, networks_in)
    else:
        trained = train_network(*given)
    if not is_rank_zero():  # it alone tests and writes
        return trained, {"checkpoint": str(trained.checkpoint)}
    if not test:
        entry = {"checkpoint": str(trained.checkpoint), "fit_seconds": trained.fit_seconds}
        return trained, entry
    return trained, _tested_network(workspace, trained, parts, draw=draw)


def fold_data(config: Config, directory: Path) -> InputData:
    """Read the data of a configuration as inputs of its network, for any Lightning Trainer."""
    model = config.model
    trust(*config.trusted, *named_classes(model.nodes))
    with suppress_thread_errors():
        opening = Opening(config.data, trained_networks(model), [config.data.test_fold])
        workspace = open_workspace(config, directory, opening)
        card = configured_card(config, model.senses, workspace.classes)
        return input_data(config, card, workspace.parts(), workspace.store)


def _tested_network(
    workspace: Workspace, trained: Trained, parts: Split, *, draw: bool
) -> dict[str, Any]:
    """Test a trained network; its entry of ``results.json``."""
    config, store, directory = workspace.config, workspace.store, workspace.directory
    classifier = trained.classifier
    classifier.to(pick_device(config.trainer.accelerator))
    kind, modalities = classifier.card.kind, classifier.card.modalities
    samples = make_samples(parts.test, modalities)
    unknown = workspace.unknown_samples(modalities)
    result, outcomes = report_network(trained, samples, store, directory, config, unknown)
    figures = {}
    if draw:
        figures = draw_figures(outcomes, workspace.classes, kind, directory)
    if draw and kind == workspace.kind:
        figures |= draw_telling(
            classifier,
            samples,
            outcomes,
            store,
            config,
            directory,
        )
    log_test(config.logger, directory, kind, plain_values(config), result, figures)
    log.info(
        "Fold %s, %s: %d of %d votes correct, trained in %.1f s.",
        workspace.data.test_fold, classifier.card.title, result["correct"], result["test_samples"],
        result["fit_seconds"],
    )  # fmt: skip
    return result
