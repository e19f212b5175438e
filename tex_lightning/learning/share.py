"""Train a network that several systems of a family have in common only once."""

import hashlib
import json
import logging
from dataclasses import asdict, replace
from pathlib import Path

import torch

from tex_lightning.classifier.card import read_checkpoint
from tex_lightning.classifier.classifier import Trained, read_trained
from tex_lightning.core.files import unwritable, write_atomically
from tex_lightning.learning.train import calibrate, train_network
from tex_lightning.learning.training import Training

log = logging.getLogger(__name__)


def train_once(training: Training, folder: Path) -> Trained:
    """Train in a folder of the family unless it was trained there, and copy the checkpoint.

    Weights depend on the seed, the card (with the recordings they see), the recipe and the start,
    so these name the place; those of a FusionNet on its parts, too.

    Args:
        training: What is trained.
        folder: The folder; made if it does not exist.

    Raises:
        UserError: If it cannot be made.
    """
    if training.final.is_file():
        return read_trained(training.final)
    recipe = {
        "card": training.card.to_dict(),
        "fit": training.fit_values,
        "seed": training.config.seed,
        "weights": training.weights,
        "trainer": training.config.trainer.flags,
    }
    if training.unimodal:
        recipe["model"] = asdict(training.config.model)
        recipe["starts"] = [_digest(start) for start in training.unimodal.values()]
    digest = hashlib.sha256(json.dumps(recipe, sort_keys=True).encode()).hexdigest()[:16]
    place = folder / f"{training.card.kind}-{digest}"
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from error
    trained = train_network(replace(training, directory=place), calibrated=False)
    content = read_checkpoint(trained.checkpoint)
    content["hyper_parameters"]["card"] = calibrate(training, trained).to_dict()
    write_atomically(training.final, lambda partial: torch.save(content, partial))
    return replace(trained, checkpoint=training.final)


def _digest(start: Trained) -> str:
    """Digest of the weights alone, since another calibration changes the rest."""
    digest = hashlib.sha256()
    for name, value in start.classifier.cpu().state_dict().items():
        digest.update(name.encode())
        digest.update(value.numpy().tobytes())
    return digest.hexdigest()
