"""Fit a baseline to the training recordings, once."""

import logging
import time
from pathlib import Path

import numpy as np

from tex_lightning.baselines.classifier import BaselineClassifier, Loaded
from tex_lightning.data.recordings import class_indices
from tex_lightning.learning.training import Training

log = logging.getLogger(__name__)


def fit_baseline(training: Training) -> Path:
    """Fit unless the checkpoint is there already; return its path.

    Raises:
        UserError: If a recording is too short, or weights do not fit.
    """
    if training.final.is_file():
        log.info("%s is fitted already.", training.final)
        return training.final
    card = training.card
    rows = training.parts.train.of(card.modalities[0]).rows
    labels = np.array(class_indices([row.label for row in rows], card.classes))
    classifier = BaselineClassifier(card)
    if training.weights is not None:
        log.info(classifier.baseline.load_weights(training.weights))
    log.info("Fitting %s to %d recordings.", card.title, len(rows))
    begin = time.perf_counter()
    recordings = Loaded(rows, training.store, classifier.branch(card.kind))
    classifier.baseline.fit(recordings, labels, training.config.seed)
    classifier.save(training.final, time.perf_counter() - begin)
    return training.final
