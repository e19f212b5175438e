"""Train one network to one checkpoint, or go on where an earlier run stopped."""

import logging
import shutil
import time
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from lightning import Callback, Trainer
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.trainer.states import TrainerStatus

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.data.banks import PhotoBank, SpectrogramBank
from tex_lightning.data.datamodule import SampleSet, SurfaceData, TrainingBatches, load_trace
from tex_lightning.data.folds import Kind, make_samples
from tex_lightning.data.recordings import Recording
from tex_lightning.devices import pick_device
from tex_lightning.errors import UserError
from tex_lightning.features.image import crop_side
from tex_lightning.features.spectrogram import HapticFeatures
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.learning.fusion import FusionModule
from tex_lightning.learning.haptic import HapticModule
from tex_lightning.learning.start import start_network
from tex_lightning.learning.trainer import make_trainer, quiet_lightning
from tex_lightning.learning.training import Training
from tex_lightning.learning.visual import VisualModule
from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.perturbations.augment import Augmentation
from tex_lightning.progress import track

log = logging.getLogger(__name__)

MODULES: dict[Kind, type[SurfaceModule]] = {
    "haptic": HapticModule,
    "visual": VisualModule,
    "fusion": FusionModule,
}


def train_network(training: Training, *watchers: Callback) -> Path:
    """Train unless the checkpoint is there already; return its path.

    Args:
        training: What is trained.
        watchers: Callbacks beside the configured ones.

    Raises:
        UserError: If a recording is too short, or weights or checkpoints do not fit.
        KeyboardInterrupt: If the user stopped it; the last finished epoch is kept.
    """
    if training.final.is_file():
        log.info("%s is trained already.", training.final)
        return training.final
    begin = time.perf_counter()
    last = training.working / "last.ckpt"
    module, data = _prepare(training, last)
    preparation = time.perf_counter() - begin
    with quiet_lightning():
        trainer, timer, keeper = make_trainer(training, *watchers)
        _fit(trainer, module, data, last if last.is_file() else None)
        module.fit_seconds = preparation + timer.time_elapsed("train")
        _finish(training, trainer, module, keeper)
    return training.final


def _prepare(training: Training, last: Path) -> tuple[SurfaceModule, SurfaceData]:
    torch.manual_seed(training.seed)
    module = MODULES[training.card.kind](
        training.card.to_dict(), training.fit_values, training.seed
    )
    batches = _make_batches(training, module)
    _check_resumable(last)
    if not last.is_file():
        start_network(training, module, batches)
    return module, _with_samples(training, batches)


def _check_resumable(last: Path) -> None:
    if last.is_file():
        try:
            torch.load(last, map_location="cpu", weights_only=True)
        except Exception as error:  # damage shows in as many ways as there are formats
            raise UserError(
                f"Checkpoint {last} is damaged; delete {last.parent} to train this network anew."
            ) from error


def _fit(trainer: Trainer, module: SurfaceModule, data: SurfaceData, last: Path | None) -> None:
    try:
        # The folder holds nothing but this package's own checkpoints of plain values and tensors.
        trainer.fit(module, datamodule=data, ckpt_path=last, weights_only=True)
    except SystemExit as stop:  # Lightning's answer to Ctrl-C
        raise KeyboardInterrupt from stop
    if trainer.state.status == TrainerStatus.INTERRUPTED:
        raise KeyboardInterrupt


def _make_batches(training: Training, module: SurfaceModule) -> TrainingBatches:
    fit, kind = training.fit_values, training.card.kind
    train, network = training.parts.train, module.classifier.network
    traces = photos = None
    if kind != "visual":
        frames = HapticNet.window if kind == "fusion" else fit["frames"]
        spectrograms = _spectrograms(training, module)
        versions = len(spectrograms) // len(train.of("haptic").rows)
        bank = SpectrogramBank(spectrograms, frames, versions)
        traces = bank, _class_indices(train.of("haptic").rows, training.card.classes)
    if kind != "haptic":
        patch = network.visual.patch if isinstance(network, FusionNet) else fit["patch"]
        rows = train.of("image").rows
        recipe = training.model.visual.fit
        augmentation = Augmentation.of(recipe.perturb, recipe.perturbed_share)
        side = crop_side(patch, fit["rotation"])
        photo_bank = PhotoBank(rows, training.store, side, augmentation)
        photos = photo_bank, _class_indices(rows, training.card.classes)
    rotation = fit.get("rotation", 0.0)
    return TrainingBatches(traces, photos, fit["batch_size"], rotation, training.seed)


def _with_samples(training: Training, batches: TrainingBatches) -> SurfaceData:
    """Add the samples to validate and to test on."""
    parts, card = training.parts, training.card
    validation, test = (
        SampleSet(make_samples(part, card.kind), training.store, card.classes)
        for part in (parts.val, parts.test)
    )
    steps = training.fit_values["steps_per_epoch"]
    return SurfaceData(batches, steps, validation, test, training.num_workers)


def _spectrograms(training: Training, module: SurfaceModule) -> list[torch.Tensor]:
    """Normalised spectrograms of all training traces; fits the normalisation for HapticNet.

    FusionNet takes the normalisation of the HapticNet it starts from. Perturbed copies of all of
    them may follow, as often as the recipe says; the normalisation is that of the clean ones.
    """
    features = module.classifier.haptic_features
    assert features is not None
    fitted = training.card.kind == "fusion"
    if fitted:
        start = SurfaceClassifier.from_checkpoint(training.unimodal["haptic"], "haptic")
        module.classifier.adopt_haptic_features(start)
    device = pick_device(training.trainer.accelerator)
    features.to(device)
    rows = training.parts.train.of("haptic").rows
    spectra = [
        features.magnitudes(load_trace(row, training.store).to(device))
        for row in track(rows, "Spectrograms")
    ]
    if not fitted:
        features.fit(spectra)
    spectra += _perturbed_magnitudes(training, features, rows)
    return [features.normalise(item).cpu() for item in spectra]


def _perturbed_magnitudes(
    training: Training, features: HapticFeatures, rows: tuple[Recording, ...]
) -> list[torch.Tensor]:
    """Spectrograms of all traces perturbed, once for each copy; seeded by recording and copy."""
    recipe, device = training.model.haptic.fit, features.window.device
    augmentation = Augmentation.of(recipe.perturb, rate=features.sampling_rate)
    if augmentation is None:
        return []
    spectra = []
    for copy in range(recipe.perturbed_copies):
        for number, row in enumerate(track(rows, "Perturbed spectrograms")):
            rng = np.random.default_rng([training.seed, copy, number])
            trace = torch.from_numpy(augmentation(np.array(training.store.trace(row)), rng))
            try:
                spectra.append(features.magnitudes(trace.to(device)))
            except UserError:  # hardly anything was left of it
                spectra.append(features.magnitudes(load_trace(row, training.store).to(device)))
    return spectra


def _class_indices(rows: tuple[Recording, ...], classes: list[str]) -> np.ndarray[Any, Any]:
    index = {label: number for number, label in enumerate(classes)}
    return np.array([index[row.label] for row in rows])


def _finish(
    training: Training, trainer: Trainer, module: SurfaceModule, keeper: ModelCheckpoint | None
) -> None:
    """Write the checkpoint of the best validation loss, or of the last step where none was asked.

    Only weights and plain values are kept; what a resumption would need goes.
    """
    if keeper is not None and keeper.best_model_path:  # there is none of no epoch
        best = torch.load(keeper.best_model_path, map_location="cpu", weights_only=True)
        module.load_state_dict(best["state_dict"])
        module.val_loss = float(cast(torch.Tensor, keeper.best_model_score))
    trainer.save_checkpoint(training.final, weights_only=True)
    if trainer.is_global_zero:
        shutil.rmtree(training.working, ignore_errors=True)
