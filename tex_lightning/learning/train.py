"""Run a training, from its recipe to its checkpoint.

:func:`train_networks` trains the networks of a model, each by a :class:`Training`. It makes the
module and the batches, and Lightning takes the steps. A callback before them gives the first
weights and fits layers in closed form. One after them measures what the checkpoint keeps beside the
weights.
"""

import hashlib
import json
import logging
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np
import torch
from lightning import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import LambdaCallback, Timer
from lightning.pytorch.loggers import Logger

from tex_lightning.baselines.classifier import BaselineClassifier, load_classifier
from tex_lightning.classifier.card import CROSSVAL, Card, configured_card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.core.console import log_once
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import write_bytes
from tex_lightning.core.progress import track
from tex_lightning.core.run_folder import checkpoint_of, find_checkpoint
from tex_lightning.data.banks import Bank, Indices
from tex_lightning.data.datamodule import SampleSet, SurfaceData, TrainingBatches
from tex_lightning.data.folds import Split, make_samples
from tex_lightning.data.recordings import Recording, class_indices
from tex_lightning.data.store import Store, load_recording
from tex_lightning.learning.epoch_checkpoints import find_resumable, take_best
from tex_lightning.learning.finish import calibrate, refit_scores, set_statistics
from tex_lightning.learning.loggers import open_loggers, show_inputs
from tex_lightning.learning.module import SurfaceModule, make_module
from tex_lightning.learning.provenance import complete_recipe
from tex_lightning.learning.start import load_trunk, load_unimodal, start_fusion, start_network
from tex_lightning.learning.trainer import (
    build_callbacks,
    fit_network,
    make_trainer,
    quiet_lightning,
)
from tex_lightning.learning.training_check import check_fitted_baseline

log = logging.getLogger(__name__)


def train_networks(
    config: Config,
    classes: list[str],
    parts: Split,
    store: Store,
    directory: Path,
    *,
    shared: Path | None = None,
    crossvalidated: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> Iterator[tuple["Training", SurfaceClassifier]]:
    """Train the networks of a model, one after the other.

    Classes are in the order of the outputs. Validation and test part may be empty; the test part is
    used only to reject given checkpoints that were trained on it. Finished checkpoints in the run
    folder are loaded and not trained again; ``shared`` is a folder with networks that several
    systems of a family have in common. ``crossvalidated`` are results of a cross-validation by
    network, for its card.

    Yields:
        Each training with its classifier, that of the whole model last.

    Raises:
        UserError: If a recording is too short, or weights or checkpoints do not fit.
        KeyboardInterrupt: If the user stopped it; the last finished epoch is kept.
    """
    model, whole = config.model, configured_card(config, classes)
    networks = {  # before time is spent on the other networks
        name: load_unimodal(find_checkpoint(path), whole.of([name]), parts.test, config.data)
        for name, path in model.checkpoints.items()
    }
    for name in track(model.trained, "network {}".format):
        last = name == model.kind
        card = whole if last else whole.of([name])
        unimodal = {sense: networks[sense] for sense in model.senses if last and sense in networks}
        trunk = load_trunk(config, card, parts.test)
        tested = {CROSSVAL: dict(crossvalidated[name])} if name in crossvalidated else {}
        card = complete_recipe(config, card, parts, store, unimodal, tested, trunk)
        loggers = open_loggers(config.logger, directory, name)
        training = Training(config, card, parts, store, directory, unimodal, trunk, loggers)
        networks[name] = training.run() if shared is None else training.run_shared(shared)
        yield training, networks[name]


@dataclass
class Training:
    """The training of one network, or the fit of a baseline.

    Attributes:
        card: Card of the classifier to train (:func:`~.provenance.complete_recipe`). The classifier
            that :meth:`run` returns has the same card with calibration and training added.
        unimodal: By sense the trained networks that FusionNet starts from; empty for one sense.
        trunk: Trained network whose trunk it starts from; None of weights from elsewhere.
        watchers: Callbacks beside the configured ones.
        batches: The training batches, made by :meth:`run`.
        timer: Clock of the training steps.
        seconds: Time spent before and after the steps, without decoding and calibration.
    """

    config: Config
    card: Card
    parts: Split
    store: Store
    directory: Path
    unimodal: Mapping[str, SurfaceClassifier] = field(default_factory=dict)
    trunk: SurfaceClassifier | None = None
    loggers: Sequence[Logger] = ()
    watchers: Sequence[Callback] = ()
    batches: TrainingBatches = field(init=False, repr=False)
    timer: Timer = field(default_factory=Timer, init=False)
    seconds: float = field(default=0.0, init=False)

    def run(self) -> SurfaceClassifier:
        """Train, calibrate and write the checkpoint, unless it is there already.

        It raises what :func:`train_networks` does.
        """
        if self.checkpoint.is_file():
            done = "fitted" if self.card.baseline else "trained"
            log.info("%s is %s already.", self.checkpoint, done)
            shutil.rmtree(self.epochs_folder, ignore_errors=True)  # a killed run may leave it
            return load_classifier(self.checkpoint)
        return self._fit_baseline() if self.card.baseline else self._train()

    def _train(self) -> SurfaceClassifier:
        """Train the network by Lightning, with :meth:`_start` and :meth:`_finish` as callbacks."""
        config = self.config
        torch.manual_seed(config.seed)
        with self._timed():
            module = make_module(config, self.card)
            if self.unimodal:  # before the batches are made: the features of its senses are fitted
                start_fusion(module, self.unimodal, config.model.fusion.head_start)
            self.batches = self._make_batches(module)
        samples = make_samples(self.parts.val, self.card.modalities)
        validation = SampleSet(samples, self.store, self.card.classes)
        fit, resumed = module.fit_config, find_resumable(self.epochs_folder)
        steps, workers = fit["steps_per_epoch"], config.data.num_workers
        data = SurfaceData(self.batches, steps, validation, workers)
        start, finish = LambdaCallback(setup=self._start), LambdaCallback(on_fit_end=self._finish)
        configured = build_callbacks(config.callbacks, config.trainer.flags)
        first = [self.timer] if resumed else [start, self.timer]
        callbacks = [*first, *self.watchers, *configured, finish]
        with quiet_lightning():
            trainer = make_trainer(
                config.trainer, callbacks, self.loggers, fit, self.epochs_folder,
                validated=bool(samples),
            )  # fmt: skip
            fit_network(trainer, module, data, resumed)
            trainer.save_checkpoint(self.checkpoint, weights_only=True)
            if trainer.is_global_zero:  # what a resumption would need goes
                shutil.rmtree(self.epochs_folder, ignore_errors=True)
        return module.classifier

    def _make_batches(self, module: SurfaceModule) -> TrainingBatches:
        """Make the bank of each sense, and the training batches that are cut from the banks."""
        fit, banks = module.fit_config, dict[str, tuple[Bank, Indices]]()
        for name, sense in module.classifier.senses.items():
            rows = self.parts.train.of(sense.modality).rows
            sense.features.to(self.device)
            recipe, size = {**self.config.model.fit_values(name), **fit}, module.piece_sizes[name]
            learn = not self.unimodal
            bank = sense.bank(rows, self.store, recipe, size=size, seed=module.seed, learn=learn)
            labels = class_indices([row.label for row in rows], self.card.classes)
            banks[name] = bank, np.array(labels)
        return TrainingBatches(banks, fit["batch_size"], module.seed)

    def _start(self, trainer: Trainer, module: LightningModule, stage: str) -> None:
        """Give the network its first weights; a resumed training does not call this."""
        module, batches, engine = cast(SurfaceModule, module), self.batches, self.config.engine
        groups = [row.group_key for row in self._rows]
        with self._timed():
            start_network(module, batches, groups, self.weights, self.trunk, self.device, engine)
            show_inputs(self.loggers, module, batches)

    def _finish(self, trainer: Trainer, module: LightningModule) -> None:
        """Take the weights of the best epoch, set statistics and calibration, complete the card."""
        module = cast(SurfaceModule, module)
        loss = take_best(module, trainer.checkpoint_callback)
        if not trainer.is_global_zero:
            return
        classifier, frozen = module.classifier.to(self.device), not module.fit_config["epochs"]
        parts, store, engine = self.parts, self.store, self.config.engine
        closed_form = frozen and all(
            network.card.training["left_out"] for network in self.unimodal.values()
        )
        banks = {name: bank for name, (bank, _) in self.batches.banks.items()}
        with self._timed():
            left_out = set_statistics(
                classifier, parts.train, store, engine, banks,
                frozen=frozen, closed_form=closed_form,
            )  # fmt: skip
            shrinkage = module.fit_config.get("score_shrinkage")
            if (
                trainer.global_step
                and shrinkage is not None
                and refit_scores(classifier, shrinkage)
            ):
                loss = None  # that of the best epoch was of other scores
        for part in classifier.trained_modules():
            layout = torch.contiguous_format
            part.to(memory_format=layout)  # type: ignore[call-overload]  # no stub
        calibration, loss = calibrate(classifier, parts, store, engine, left_out, loss)
        seconds = self.seconds + self.timer.time_elapsed("train")
        training = {"fit_seconds": seconds, "val_loss": loss, "left_out": left_out}
        self._complete(classifier.cpu(), calibration, training)
        module.hparams["card"] = classifier.card.to_dict()

    def _fit_baseline(self) -> SurfaceClassifier:
        """Fit a baseline, calibrate it and write its checkpoint."""
        rows, weights = self._rows, self.card.baseline["weights"]
        classifier = BaselineClassifier(self.card)
        if weights is not None:
            log_once(log, classifier.baseline.load_weights(weights))
        log.info("Fitting %s to %d recordings.", self.card.title, len(rows))
        with self._timed():
            classifier.fit(rows, self.store, self.config.seed)
        check_fitted_baseline(classifier, [load_recording(row, self.store) for row in rows[:2]])
        engine = self.config.engine
        calibration, loss = calibrate(classifier, self.parts, self.store, engine, {}, None)
        self._complete(classifier, calibration, {"fit_seconds": self.seconds, "val_loss": loss})
        classifier.save(self.checkpoint)
        return classifier

    def _complete(
        self, classifier: SurfaceClassifier, calibration: dict[str, Any], training: dict[str, Any]
    ) -> None:
        """Give the classifier its final card: that of the recipe, with calibration and training."""
        training = {**self.card.training, **training}
        classifier.card = replace(self.card, calibration=calibration, training=training)

    def run_shared(self, folder: Path) -> SurfaceClassifier:
        """Train in a folder that the systems of a family share, and copy the checkpoint from there.

        So a network that several systems have in common is trained once. The name of its folder is
        a digest of all that its weights depend on: card, recipe, seed and first weights.
        """
        config, kind = self.config, self.card.kind
        if self.card.baseline:
            return self.run()
        recipe = {
            "card": self.card.to_dict(),
            "fit": config.model.fit_values(kind),
            "seed": config.seed,
            "weights": self.weights,
            "trainer": config.trainer.flags,
        }
        if self.unimodal:
            recipe["model"] = asdict(config.model)
            recipe["starts"] = [network.card.to_dict() for network in self.unimodal.values()]
        digest = hashlib.sha256(json.dumps(recipe, sort_keys=True).encode()).hexdigest()[:16]
        shared = replace(self, directory=folder / f"{kind}-{digest}")
        classifier = shared.run()
        write_bytes(self.checkpoint, shared.checkpoint.read_bytes())
        return classifier

    @property
    def checkpoint(self) -> Path:
        """The checkpoint that the training writes."""
        return checkpoint_of(self.directory, self.card.kind)

    @property
    def epochs_folder(self) -> Path:
        """Folder of the checkpoints of its epochs; it is removed at the end."""
        return self.checkpoint.with_suffix("")

    @property
    def device(self) -> torch.device:
        """Device that computes features and statistics."""
        return pick_device(self.config.trainer.accelerator)

    @property
    def weights(self) -> str | None:
        """Source of the trunk's first weights; None is random."""
        return self.config.sources.get(self.card.kind)

    @property
    def _rows(self) -> Sequence[Recording]:
        """The training recordings of the first sense."""
        return self.parts.train.of(self.card.modalities[0]).rows

    @contextmanager
    def _timed(self) -> Iterator[None]:
        begin = time.perf_counter()
        yield
        self.seconds += time.perf_counter() - begin
