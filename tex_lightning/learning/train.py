"""Train one network to one checkpoint, or go on where an earlier run stopped.

A network that several systems of a family have in common is trained once.
"""

import hashlib
import json
import logging
import shutil
import time
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import cast

import numpy as np
import torch
from lightning import Callback, Trainer
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.trainer.states import TrainerStatus

from tex_lightning.classifier.card import Card, read_checkpoint
from tex_lightning.classifier.classifier import SurfaceClassifier, Trained, read_trained
from tex_lightning.config.model import FUSION
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import unwritable, write_atomically
from tex_lightning.core.progress import hidden
from tex_lightning.data.datamodule import SampleSet, SurfaceData, TrainingBatches
from tex_lightning.data.folds import make_samples
from tex_lightning.data.recordings import class_indices
from tex_lightning.data.store import load_recording
from tex_lightning.errors import UserError
from tex_lightning.evaluation.calibration import calibrated_card
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.learning.callbacks import ProgressBar
from tex_lightning.learning.fusion import FusionModule
from tex_lightning.learning.inputs import InputData
from tex_lightning.learning.start import fits_probabilities, start_network
from tex_lightning.learning.statistics import card_with_novelties, keep_statistics
from tex_lightning.learning.trainer import make_trainer, quiet_lightning
from tex_lightning.learning.training import Training
from tex_lightning.learning.trial import check_rebuilt

log = logging.getLogger(__name__)
ONE_VALUE = "Expected more than 1 value per channel"  # says PyTorch of batch normalisation


def train_network(training: Training, *watchers: Callback, calibrated: bool = True) -> Trained:
    """Train, calibrate and write the checkpoint, unless it is there already.

    Args:
        training: What is trained.
        watchers: Callbacks beside the configured ones.
        calibrated: Whether probabilities and thresholds are set on the validation fold.

    Raises:
        UserError: If a recording is too short, or weights or checkpoints do not fit.
        KeyboardInterrupt: If the user stopped it; the last finished epoch is kept.
    """
    if training.final.is_file():
        log.info("%s is trained already.", training.final)
        shutil.rmtree(training.working, ignore_errors=True)  # if it was killed before it did so
        return read_trained(training.final, training.card.kind)
    begin = time.perf_counter()
    last = training.working / "last.ckpt"
    module, data = _prepare(training, last)
    preparation = time.perf_counter() - begin
    with quiet_lightning():
        trainer, timer, keeper = make_trainer(training, *watchers)
        _fit(trainer, module, data, last if last.is_file() else None)
        module.fit_seconds = preparation + timer.time_elapsed("train")
        _finish(training, trainer, module, keeper, calibrated)
    seconds, loss = module.fit_seconds, module.val_loss
    return Trained(module.classifier, training.final, seconds, loss, module.left_out)


def _prepare(training: Training, last: Path) -> tuple[SurfaceModule, SurfaceData]:
    module = _new_module(training)
    batches = _make_batches(training, module)
    _check_resumable(last)
    if not last.is_file():
        start_network(training, module, batches)
    return module, _with_samples(training, batches)


def _new_module(training: Training) -> SurfaceModule:
    torch.manual_seed(training.config.seed)
    make = FusionModule if training.card.kind == FUSION else SurfaceModule
    pieces = {
        name: training.config.model.sense(name).fit.piece for name in training.card.sense_names
    }
    return make(training.card.to_dict(), training.fit_values, training.config.seed, pieces)


def input_data(training: Training) -> InputData:
    """Make batches of network inputs; features learn what they have to from the training part."""
    module = _new_module(training)
    data = _with_samples(training, _make_batches(training, module))
    return InputData(data, module.eval())


def _check_resumable(last: Path) -> None:
    if last.is_file():
        try:
            torch.load(last, map_location="cpu", weights_only=True)
        except Exception as error:  # damage shows in as many ways as there are formats
            raise UserError(
                f"Checkpoint {last} is damaged; delete {last.parent} to train this network anew."
            ) from error


def _fit(trainer: Trainer, module: SurfaceModule, data: SurfaceData, last: Path | None) -> None:
    own = trainer.progress_bar_callback is None or isinstance(
        trainer.progress_bar_callback, ProgressBar
    )
    try:
        with nullcontext() if own else hidden():
            # The folder holds only this package's own checkpoints of plain values and tensors.
            trainer.fit(module, datamodule=data, ckpt_path=last, weights_only=True)
    except ValueError as error:
        if ONE_VALUE not in str(error):
            raise
        kind = module.classifier.card.kind
        raise UserError(
            "Batch normalisation takes more than one position of a batch; raise "
            f"model.{kind}.fit.batch_size, or set norm=none of what is trained."
        ) from error
    except SystemExit as stop:  # Lightning's answer to Ctrl-C
        raise KeyboardInterrupt from stop
    if trainer.state.status == TrainerStatus.INTERRUPTED:
        raise KeyboardInterrupt


def _make_batches(training: Training, module: SurfaceModule) -> TrainingBatches:
    """Cut from the training recordings of every sense, its features on the device."""
    classifier, card, banks = module.classifier, training.card, {}
    for name, start in training.unimodal.items():
        classifier.sense(name).adopt(start.classifier.sense(name))
    classifier.features.to(pick_device(training.config.trainer.accelerator))
    for name, sense in classifier.senses.items():
        rows = training.parts.train.of(sense.modality).rows
        labels = np.array(class_indices([row.label for row in rows], card.classes))
        bank = sense.bank(
            rows, training.store, {**training.config.model.fit_values(name), **training.fit_values},
            size=module.pieces[name], seed=training.config.seed, learn=not training.unimodal,
        )  # fmt: skip
        banks[name] = bank, labels
    return TrainingBatches(banks, training.fit_values["batch_size"], training.config.seed)


def _with_samples(training: Training, batches: TrainingBatches) -> SurfaceData:
    """Add the samples to validate and to test on."""
    parts, card = training.parts, training.card
    validation, test = (
        SampleSet(make_samples(part, card.modalities), training.store, card.classes)
        for part in (parts.val, parts.test)
    )
    steps = training.fit_values["steps_per_epoch"]
    return SurfaceData(batches, steps, validation, test, training.config.data.num_workers)


def _keep_statistics(training: Training, module: SurfaceModule) -> None:
    begin = time.perf_counter()
    module.classifier.to(pick_device(training.config.trainer.accelerator))
    left_out = keep_statistics(module.classifier, training.parts.train, training.store)
    if _features_are_untrained(training):  # else these recordings fit too well
        module.left_out = left_out
    module.classifier.cpu()
    module.fit_seconds += time.perf_counter() - begin


def calibrate(training: Training, trained: Trained) -> Card:
    """Complete the card of a trained network by what is set on the validation fold."""
    classifier, parts, store = trained.classifier, training.parts, training.store
    classifier.to(pick_device(training.config.trainer.accelerator))
    validation = make_samples(parts.val, classifier.card.modalities)
    fitted = any(trained.left_out.values()) and fits_probabilities(classifier.network)
    classifier.card = calibrated_card(classifier, validation, store, training.config, fitted=fitted)
    classifier.card = card_with_novelties(classifier, trained.left_out, parts, store)
    classifier.cpu()
    return classifier.card


def _check_state(training: Training, classifier: SurfaceClassifier) -> None:
    """Check that a checkpoint will hold all that a user's parts have learnt."""
    (first, *more) = classifier.senses.values()
    if not more and not first.is_builtin:
        row = training.parts.train.of(first.modality).rows[0]
        check_rebuilt(classifier.eval(), [load_recording(row, training.store).to(first.device)])


def _features_are_untrained(training: Training) -> bool:
    """Whether no layer before the scores was fitted to the labels."""
    starts = training.unimodal.values()
    return training.fit_values["epochs"] == 0 and all(start.left_out for start in starts)


def _refuse_diverged(module: SurfaceModule) -> None:
    if not _is_finite(module):
        classifier = module.classifier
        kind, parts = classifier.card.kind, classifier.senses.values()
        own = "" if all(each.is_builtin for each in parts) else ", or look for what makes NaN in it"
        raise UserError(
            f"Training of the {kind} network diverged, its weights are NaN or infinite; lower "
            f"model.{kind}.fit.learning_rate{own}."
        )


def _is_finite(module: SurfaceModule) -> bool:
    return all(bool(each.isfinite().all()) for each in module.state_dict().values())


def _finish(
    training: Training,
    trainer: Trainer,
    module: SurfaceModule,
    keeper: ModelCheckpoint | None,
    calibrated: bool,
) -> None:
    """Write the checkpoint of the best validation loss, or of the last step where none was asked.

    Only weights and plain values are kept; what a resumption would need goes.
    """
    if keeper is not None and keeper.best_model_path:  # there is none of no epoch
        best = torch.load(keeper.best_model_path, map_location="cpu", weights_only=True)
        if not _is_finite(module):
            kind = module.classifier.card.kind
            log.warning(
                "Training of the %s network diverged; its weights are those of epoch %d, the best "
                "one. Lower model.%s.fit.learning_rate.", kind, best["epoch"] + 1, kind,
            )  # fmt: skip
        module.load_state_dict(best["state_dict"])
        module.val_loss = float(cast(torch.Tensor, keeper.best_model_score))
    _refuse_diverged(module)
    module.float()  # whatever it was trained in
    if trainer.is_global_zero:
        _check_state(training, module.classifier)
        _keep_statistics(training, module)
        if calibrated:
            module.network.to(memory_format=torch.contiguous_format)  # as a loaded one is
            trained = Trained(module.classifier, training.final, 0.0, None, module.left_out)
            module.hparams["card"] = calibrate(training, trained).to_dict()
    trainer.save_checkpoint(training.final, weights_only=True)
    if trainer.is_global_zero:
        shutil.rmtree(training.working, ignore_errors=True)


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
