"""Train and test all networks of a model on one fold."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.baselines.training import fit_baseline
from tex_lightning.card import Card
from tex_lightning.config import Config, plain_values
from tex_lightning.config.model import FUSION
from tex_lightning.data.folds import Split, make_samples
from tex_lightning.data.unusable import skipped_entry
from tex_lightning.devices import pick_device
from tex_lightning.evaluation.calibrate import calibrate
from tex_lightning.evaluation.outcomes import RANDOM, environment
from tex_lightning.learning.share import train_shared
from tex_lightning.learning.start import name_source
from tex_lightning.learning.train import train_network
from tex_lightning.learning.training import Training
from tex_lightning.loggers import log_test
from tex_lightning.ranks import is_rank_zero
from tex_lightning.runs.testing import draw_figures, report_network
from tex_lightning.runs.workspace import (
    Workspace,
    given_checkpoints,
    make_card,
    starting_card,
)

log = logging.getLogger(__name__)


def results_frame(workspace: Workspace, networks: dict[str, Any], seconds: float) -> dict[str, Any]:
    """What every training task's ``results.json`` holds around its networks."""
    config = workspace.config
    return {
        "task": config.task,
        "model": config.model.name,
        "data": config.data.name,
        "classes": workspace.classes,
        "weights": weights(config),
        "seed": config.seed,
        "wall_seconds": seconds,
        "skipped": skipped_entry(workspace.skipped),
        "environment": environment(pick_device(config.trainer.accelerator)),
        "networks": networks,
    }


def weights(config: Config) -> dict[str, str]:
    """By sense where the weights of its network, or of its trunk, came from."""
    given = {
        name: config.model.checkpoints.get(name) or config.weights_of(name)
        for name in config.model.senses
    }
    return {name: RANDOM if path is None else name_source(path) for name, path in given.items()}


def fit_fold(workspace: Workspace) -> dict[str, Any]:
    """Train and test all networks that the model consists of on one fold."""
    parts = workspace.parts()
    unimodal: dict[str, Path] = {}
    networks: dict[str, Any] = {}
    if workspace.kind == FUSION:
        given = given_checkpoints(workspace.config)
        for name, path in given.items():
            starting_card(workspace, name, path)  # before time is spent on the other networks
        for name in workspace.config.model.senses:
            if name not in given:
                networks[name] = _fit_network(workspace, parts, [name], {})
            unimodal[name] = given.get(name) or Path(networks[name]["checkpoint"])
    senses = workspace.config.model.senses
    networks[workspace.kind] = _fit_network(workspace, parts, senses, unimodal)
    return networks


def _fit_network(
    workspace: Workspace, parts: Split, senses: Sequence[str], unimodal: dict[str, Path]
) -> dict[str, Any]:
    card, shared = make_card(workspace, senses, unimodal), workspace.config.crossval.share
    training = make_training(workspace, card, parts, unimodal)
    if card.baseline:
        checkpoint = fit_baseline(training)
    elif shared is not None:
        checkpoint = train_shared(training, Path(shared).expanduser())
    else:
        checkpoint = train_network(training)
    if not is_rank_zero():  # it alone tests and writes
        return {"checkpoint": str(checkpoint)}
    return _tested_network(workspace, checkpoint, parts)


def make_training(
    workspace: Workspace, card: Card, parts: Split, unimodal: dict[str, Path]
) -> Training:
    """What the training of one network reads of the configuration."""
    config = workspace.config
    source = None if card.kind == FUSION else config.weights_of(card.kind)
    return Training(
        card=card,
        parts=parts,
        store=workspace.store,
        directory=workspace.directory,
        unimodal=unimodal,
        seed=config.seed,
        weights=config.weights if card.baseline else source,
        model=config.model,
        trainer=config.trainer,
        callbacks=config.callbacks,
        logger=config.logger,
        num_workers=config.data.num_workers,
    )


def _tested_network(workspace: Workspace, checkpoint: Path, parts: Split) -> dict[str, Any]:
    """Calibrate and test a trained network; its entry of ``results.json``."""
    classifier = load_classifier(checkpoint)
    classifier.to(pick_device(workspace.config.trainer.accelerator))
    config, store, directory = workspace.config, workspace.store, workspace.directory
    kind, modalities = classifier.card.kind, classifier.card.modalities
    validation, samples = (make_samples(part, modalities) for part in (parts.val, parts.test))
    calibrate(classifier, checkpoint, validation, store, config.engine, config.decision)
    unknown = workspace.unknown_samples(modalities)
    result, outcomes = report_network(
        classifier, checkpoint, samples, store, directory, config, unknown
    )
    figures = {}
    if config.task == "fit":  # others draw what they have pooled over the folds
        figures = draw_figures(outcomes, workspace.classes, kind, directory)
    log_test(config.logger, directory, kind, plain_values(config), result, figures)
    title = classifier.card.title
    log.info("%s: %d of %d votes correct.", title, result["correct"], result["test_samples"])
    return result
