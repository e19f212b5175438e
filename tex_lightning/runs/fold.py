"""Train and test all networks of a model on one fold."""

import logging
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.baselines.training import fit_baseline
from tex_lightning.card import Card
from tex_lightning.config import Config
from tex_lightning.data.folds import Kind, Split, make_samples
from tex_lightning.data.unusable import skipped_entry
from tex_lightning.devices import pick_device
from tex_lightning.evaluation.calibrate import calibrate
from tex_lightning.evaluation.outcomes import RANDOM, environment
from tex_lightning.learning.share import train_shared
from tex_lightning.learning.start import name_source
from tex_lightning.learning.train import train_network
from tex_lightning.learning.training import Training
from tex_lightning.loggers import log_test
from tex_lightning.parts import UNIMODAL
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
        "trunk_weights": trunk_weights(config),
        **haptic_trunk_weights(config),
        "seed": config.seed,
        "wall_seconds": seconds,
        "skipped": skipped_entry(workspace.skipped),
        "environment": environment(pick_device(config.trainer.accelerator)),
        "networks": networks,
    }


def trunk_weights(config: Config) -> str | None:
    """Where the visual trunk's weights came from, if there is one; else those of HapticNet's."""
    model = config.model
    if model.kind != "haptic":
        trunk = model.baseline is None or "trunk" in model.baseline
        given = config.weights_of("visual") or model.fusion.visual_checkpoint
        return (RANDOM if given is None else name_source(given)) if trunk else None
    given = config.weights_of("haptic")
    return None if given is None else name_source(given)


def haptic_trunk_weights(config: Config) -> dict[str, str]:
    """Where those of a FusionNet's HapticNet came from, if they were given."""
    given = config.model.fusion.haptic_checkpoint or config.weights_of("haptic")
    if config.model.kind != "fusion" or given is None:
        return {}
    return {"haptic_trunk_weights": name_source(given)}


def fit_fold(workspace: Workspace) -> dict[str, Any]:
    """Train and test all networks that the model consists of on one fold."""
    parts = workspace.parts()
    unimodal: dict[Kind, Path] = {}
    networks: dict[str, Any] = {}
    if workspace.kind == "fusion":
        unimodal = given_checkpoints(workspace.config)
        for kind, path in unimodal.items():
            starting_card(workspace, kind, path)  # before time is spent on the other network
        for kind in UNIMODAL:
            if kind not in unimodal:
                networks[kind] = _fit_network(workspace, parts, kind, {})
                unimodal[kind] = Path(networks[kind]["checkpoint"])
    networks[workspace.kind] = _fit_network(workspace, parts, workspace.kind, unimodal)
    return networks


def _fit_network(
    workspace: Workspace,
    parts: Split,
    kind: Kind,
    unimodal: dict[Kind, Path],
) -> dict[str, Any]:
    card, shared = make_card(workspace, kind, unimodal), workspace.config.crossval.share
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
    workspace: Workspace, card: Card, parts: Split, unimodal: dict[Kind, Path]
) -> Training:
    """What the training of one network reads of the configuration."""
    config = workspace.config
    source = None if card.kind == "fusion" else config.weights_of(card.kind)
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
    kind = classifier.card.kind
    calibrate(
        classifier, checkpoint, make_samples(parts.val, kind), store, config.engine, config.decision
    )
    samples = make_samples(parts.test, kind)
    unknown = workspace.unknown_samples(kind)
    result, outcomes = report_network(
        classifier, checkpoint, samples, store, directory, config, unknown
    )
    figures = {}
    if config.task == "fit":  # others draw what they have pooled over the folds
        figures = draw_figures(outcomes, workspace.classes, kind, directory)
    log_test(config.logger, directory, kind, asdict(config), result, figures)
    title = classifier.card.title
    log.info("%s: %d of %d votes correct.", title, result["correct"], result["test_samples"])
    return result
