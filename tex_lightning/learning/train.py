"""Train one network to one checkpoint, or go on where an earlier run stopped."""

import hashlib
import json
import logging
import shutil
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import cast

import numpy as np
import torch
from lightning import Callback, Trainer
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.loggers import Logger
from lightning.pytorch.trainer.states import TrainerStatus

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.core.devices import pick_device
from tex_lightning.core.progress import hidden
from tex_lightning.data.banks import Bank, Indices
from tex_lightning.data.datamodule import SampleSet, SurfaceData, TrainingBatches
from tex_lightning.data.folds import Split, make_samples
from tex_lightning.data.recordings import class_indices
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError
from tex_lightning.learning.inputs import show_inputs
from tex_lightning.learning.module import SurfaceModule, start_fusion
from tex_lightning.learning.start import start_network
from tex_lightning.learning.statistics import complete_card, keep_statistics
from tex_lightning.learning.trainer import (
    ProgressBar,
    build_callbacks,
    make_trainer,
    quiet_lightning,
)

log = logging.getLogger(__name__)
ONE_VALUE = "Expected more than 1 value per channel"  # PyTorch's words of batch normalisation


def checkpoint_of(directory: Path, kind: str) -> Path:
    """Return the checkpoint of a network in a run folder."""
    return directory / "checkpoints" / f"{kind}.ckpt"


@dataclass(frozen=True)
class Training:
    """One training of one network, from its recipe to its result.

    Attributes:
        config: The configuration: recipes, starts, flags of the trainer, callbacks, engine, seed.
        card: The recipe: the card of the classifier to train, with what its recordings say.
        parts: Recordings by part.
        store: Decoded files.
        directory: The run folder.
        starts: By sense the networks that FusionNet starts from; empty for the others.
        loggers: Loggers of this network.
        watchers: Callbacks beside the configured ones.
    """

    config: Config
    card: Card
    parts: Split
    store: Store
    directory: Path
    starts: Mapping[str, SurfaceClassifier] = field(default_factory=dict)
    loggers: Sequence[Logger] = ()
    watchers: Sequence[Callback] = ()

    @property
    def final(self) -> Path:
        """The checkpoint that it ends with."""
        return checkpoint_of(self.directory, self.card.kind)

    @property
    def working(self) -> Path:
        """Folder of the checkpoints of its epochs, which goes once it has ended."""
        return self.final.with_suffix("")

    @property
    def device(self) -> torch.device:
        """Device that computes features and statistics."""
        return pick_device(self.config.trainer.accelerator)

    @property
    def weights(self) -> str | None:
        """Source of the trunk's first weights; None is random."""
        return self.config.sources.get(self.card.kind)

    @property
    def groups(self) -> list[str]:
        """Group of each training recording of the first sense."""
        return [row.group_key for row in self.parts.train.of(self.card.modalities[0]).rows]

    def run(self) -> SurfaceClassifier:
        """Train, calibrate and write the checkpoint, unless it is there already.

        Raises:
            UserError: If a recording is too short, or weights or checkpoints do not fit.
            KeyboardInterrupt: If the user stopped it; the last finished epoch is kept.
        """
        if self.final.is_file():
            log.info("%s is trained already.", self.final)
            shutil.rmtree(self.working, ignore_errors=True)  # if it was killed before it did so
            return SurfaceClassifier.from_checkpoint(self.final, self.card.kind)
        begin, last, config = time.perf_counter(), self.working / "last.ckpt", self.config
        torch.manual_seed(config.seed)
        module = make_module(config, self.card)
        batches = self._make_batches(module)
        resumed, fit = _check_resumable(last), module.fit_config
        if not resumed:
            start_network(module, batches, self.groups, self.weights, self.device, config.engine)
            show_inputs(self.loggers, module, batches)
        samples = make_samples(self.parts.val, self.card.modalities)
        validation = SampleSet(samples, self.store, self.card.classes)
        data = SurfaceData(batches, fit["steps_per_epoch"], validation, config.data.num_workers)
        preparation = time.perf_counter() - begin
        callbacks = [*self.watchers, *build_callbacks(config.callbacks, config.trainer.flags)]
        with quiet_lightning():
            trainer, timer, keeper = make_trainer(
                config.trainer, callbacks, self.loggers, fit, self.working,
                validated=bool(samples),
            )  # fmt: skip
            _fit(trainer, module, data, last if resumed else None)
            loss = _take_best(module, keeper)
            if trainer.is_global_zero:
                self._complete(module, preparation + timer.time_elapsed("train"), loss)
            trainer.save_checkpoint(self.final, weights_only=True)
            if trainer.is_global_zero:  # what a resumption would need goes
                shutil.rmtree(self.working, ignore_errors=True)
        return module.classifier

    def _make_batches(self, module: SurfaceModule) -> TrainingBatches:
        """Make the batches that are cut from the recordings of every sense.

        A FusionNet gets the weights of its networks before, whose features have learnt already.
        """
        fit, seed, classifier = module.fit_config, module.seed, module.classifier
        if self.starts:
            start_fusion(module, self.starts, self.config.model.fusion.head_start)
        banks: dict[str, tuple[Bank, Indices]] = {}
        for name, sense in classifier.senses.items():
            rows = self.parts.train.of(sense.modality).rows
            labels = np.array(class_indices([row.label for row in rows], self.card.classes))
            sense.features.to(self.device)
            recipe, size = {**self.config.model.fit_values(name), **fit}, module.pieces[name]
            learn = not self.starts
            bank = sense.bank(rows, self.store, recipe, size=size, seed=seed, learn=learn)
            banks[name] = bank, labels
        return TrainingBatches(banks, fit["batch_size"], seed)

    def _complete(self, module: SurfaceModule, seconds: float, loss: float | None) -> None:
        """Add statistics of the features, and to the card what is known once the weights are.

        Args:
            module: Trained, on the CPU, where it is left.
            seconds: Time that the training took so far.
            loss: Validation loss of the weights, where it was computed.
        """
        begin, classifier = time.perf_counter(), module.classifier.to(self.device)
        frozen, engine = not module.fit_config["epochs"], self.config.engine
        left_out = keep_statistics(classifier, self.parts.train, self.store, engine, frozen=frozen)
        fixed = all(start.card.training["left_out"] for start in self.starts.values())
        if not (frozen and fixed):  # layers before the scores know the recordings
            left_out = {}
        seconds += time.perf_counter() - begin
        for part in classifier.trained_modules():
            layout = torch.contiguous_format
            part.to(memory_format=layout)  # type: ignore[call-overload]  # no stub
        training = {"fit_seconds": seconds, "val_loss": loss, "left_out": left_out}
        known = classifier.card.training  # before: of a cross-validation
        classifier.card = replace(classifier.card, training={**known, **training})
        complete_card(classifier, self.parts, self.store, engine)
        module.hparams["card"] = classifier.cpu().card.to_dict()

    def shared_in(self, folder: Path) -> Path:
        """Return the folder of this network among those that systems of a family share.

        So one run trains it. Weights depend on the seed, the card (with the recordings they see),
        the recipe and the start, so these name the folder; those of a FusionNet on its parts, too.

        Args:
            folder: Folder of the networks of the family.
        """
        config, kind = self.config, self.card.kind
        recipe = {
            "card": self.card.to_dict(),
            "fit": config.model.fit_values(kind),
            "seed": config.seed,
            "weights": self.weights,
            "trainer": config.trainer.flags,
        }
        if self.starts:
            recipe["model"] = asdict(config.model)
            recipe["starts"] = [start.card.to_dict() for start in self.starts.values()]
        digest = hashlib.sha256(json.dumps(recipe, sort_keys=True).encode()).hexdigest()[:16]
        return folder / f"{kind}-{digest}"


def make_module(config: Config, card: Card) -> SurfaceModule:
    """Make the module that trains a network of the model."""
    model = config.model
    pieces = {name: model.sense(name).fit.piece for name in card.sense_names}
    return SurfaceModule(card, model.fit_values(card.kind), config.seed, pieces, config.engine)


def _check_resumable(last: Path) -> bool:
    """Return whether there is a checkpoint to go on from."""
    if not last.is_file():
        return False
    try:
        torch.load(last, map_location="cpu", weights_only=True)
    except Exception as error:  # damage shows in as many ways as there are formats
        raise UserError(
            f"Checkpoint {last} is damaged; delete {last.parent} to train this network anew."
        ) from error
    return True


def _fit(trainer: Trainer, module: SurfaceModule, data: SurfaceData, last: Path | None) -> None:
    bar = trainer.progress_bar_callback
    try:
        with nullcontext() if bar is None or isinstance(bar, ProgressBar) else hidden():
            # The folder holds only this package's own checkpoints of plain values and tensors.
            trainer.fit(module, datamodule=data, ckpt_path=last, weights_only=True)
    except ValueError as error:
        if ONE_VALUE not in str(error):
            raise
        raise UserError(
            "Batch normalisation takes more than one position of a batch; raise "
            f"model.{module.kind}.fit.batch_size, or set norm=none of what is trained."
        ) from error
    except SystemExit as stop:  # Lightning's answer to Ctrl-C
        raise KeyboardInterrupt from stop
    if trainer.state.status == TrainerStatus.INTERRUPTED:
        raise KeyboardInterrupt


def _take_best(module: SurfaceModule, keeper: ModelCheckpoint | None) -> float | None:
    """Load the weights of the best validation loss, where it was computed, and return it.

    Raises:
        UserError: If the weights are NaN or infinite.
    """
    loss = None
    if keeper is not None and keeper.best_model_path:  # there is none of no epoch
        best = torch.load(keeper.best_model_path, map_location="cpu", weights_only=True)
        if not _is_finite(module):
            log.warning(
                "Training of the %s network diverged; its weights are those of epoch %d, the best "
                "one. Lower model.%s.fit.learning_rate.",
                module.kind, best["epoch"] + 1, module.kind,
            )  # fmt: skip
        module.load_state_dict(best["state_dict"])
        loss = float(cast(torch.Tensor, keeper.best_model_score))
    if not _is_finite(module):
        raise UserError(
            f"Training of the {module.kind} network diverged, its weights are NaN or infinite; "
            f"lower model.{module.kind}.fit.learning_rate."
        )
    module.float()  # whatever it was trained in
    return loss


def _is_finite(module: SurfaceModule) -> bool:
    return all(bool(value.isfinite().all()) for value in module.state_dict().values())
