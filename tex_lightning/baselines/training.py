"""Fit a baseline to the training recordings, once."""

import logging
import time

import numpy as np

from tex_lightning.baselines.classifier import BaselineClassifier, Loaded, load_trained
from tex_lightning.classifier import Trained
from tex_lightning.data.folds import make_samples
from tex_lightning.data.recordings import class_indices
from tex_lightning.evaluation.calibrate import calibrated_card
from tex_lightning.learning.training import Training
from tex_lightning.screen import log_once

log = logging.getLogger(__name__)


def fit_baseline(training: Training) -> Trained:
    """Fit, calibrate and write the checkpoint, unless it is there already.

    Raises:
        UserError: If a recording is too short, or weights do not fit.
    """
    if training.final.is_file():
        log.info("%s is fitted already.", training.final)
        return load_trained(training.final)
    card = training.card
    rows = training.parts.train.of(card.modalities[0]).rows
    labels = np.array(class_indices([row.label for row in rows], card.classes))
    classifier = BaselineClassifier(card)
    if training.weights is not None:
        log_once(log, classifier.baseline.load_weights(training.weights))
    log.info("Fitting %s to %d recordings.", card.title, len(rows))
    begin = time.perf_counter()
    recordings = Loaded(rows, training.store, classifier.branch(card.kind))
    classifier.baseline.fit(recordings, labels, training.config.seed)
    seconds = time.perf_counter() - begin
    validation = make_samples(training.parts.val, card.modalities)
    classifier.card = calibrated_card(classifier, validation, training.store, training.config)
    classifier.save(training.final, seconds)
    return Trained(classifier, training.final, seconds)
