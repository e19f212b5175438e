"""The LightningModule that trains the network of one sense, or FusionNet.

FusionNet starts from trained networks of its senses (paper, section III-B). It learns on crops that
give one position each, with a higher learning rate for its head.
"""

import math
from functools import partial
from typing import Any, Self

import torch
from lightning import LightningModule
from lightning.pytorch.plugins import MixedPrecision
from torch import Tensor, nn
from torch.optim.lr_scheduler import LRScheduler, ReduceLROnPlateau
from torchmetrics.classification import MulticlassAccuracy

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, EngineConfig
from tex_lightning.config.instantiation import build, call
from tex_lightning.config.model import FUSION
from tex_lightning.core.contract import keep_key
from tex_lightning.core.devices import full_precision, has_to_repeat
from tex_lightning.data.datamodule import Batch
from tex_lightning.errors import UserError
from tex_lightning.learning.validation import Validation
from tex_lightning.networks.blocks import is_builtin
from tex_lightning.networks.fusionnet import FusionLayer
from tex_lightning.senses.base import Augment
from tex_lightning.senses.photo import apply_augmentation

REFRESH = 5  # steps, after which the progress bar shows new figures
APART = 1 << 50  # between the dropout of two processes, more than seeds and epochs span


class SurfaceModule(LightningModule):
    """Train a :class:`SurfaceClassifier` on pieces (crops) of recordings.

    Each position of a piece is a fragment with the label of its recording. FusionNet is trained on
    tuples of fragments of the same class, one of each sense.

    Logged: ``train/loss`` (cross entropy per fragment, lower is better), the share of correct
    fragments as ``train/fragment_accuracy`` (higher is better), ``lr/backbone`` and ``lr/head``;
    with a validation fold ``val/loss`` and the shares of correct fragments and of correct samples,
    ``val/fragment_accuracy`` and ``val/vote_accuracy``.

    Args:
        card: Card of the classifier to train.
        fit: The training recipe, ``model.NAME.fit``, as plain values.
        seed: Seed of dropout; batches have their own.
        piece_sizes: By sense the length or side of the pieces. FusionNet takes pieces of one
            fragment instead, where the size of a fragment is known.
        engine: Settings of the accelerated copy for validation; None uses none.
    """

    def __init__(
        self,
        card: Card,
        fit: dict[str, Any],
        seed: int,
        piece_sizes: dict[str, int],
        engine: EngineConfig | None = None,
    ) -> None:
        super().__init__()
        kept = {"card": card.to_dict(), "fit": fit, "seed": seed, "pieces": piece_sizes}
        self.save_hyperparameters(kept, logger=False)
        self.classifier, self.kind = SurfaceClassifier(card), card.kind
        self.layout = training_layout(self.classifier)
        if self.kind == FUSION:
            senses = self.classifier.senses.items()
            piece_sizes = {name: sense.piece_size(piece_sizes[name]) for name, sense in senses}
        else:
            self.network.to(memory_format=self.layout)
        self.fit_config, self.seed, self.piece_sizes = fit, seed, piece_sizes
        node, key = fit.get("augmentation"), f"model.{self.kind}.fit.augmentation"
        self.augmentation: Any = None if node is None else build(key, node)
        classes = len(card.classes)
        self.train_accuracy = accuracy(classes)
        self.validation = Validation(engine)
        self.fragment_accuracy, self.vote_accuracy = accuracy(classes), accuracy(classes)

    def inputs(self, batch: Batch) -> list[Tensor]:
        """Return the network inputs (batch, ...) of a training batch, in float32, by sense."""
        augment, inputs = self.augment if self.training else None, []
        for name, sense in self.classifier.senses.items():
            with full_precision(sense.device):
                x = sense.training_input(batch[name], self.piece_sizes[name], augment)
            inputs.append(x.contiguous() if self.layout is torch.contiguous_format else x)
        return inputs

    @property
    def augment(self) -> Augment | None:
        """The recipe's augmentation of photos (batch, 3, side, side) in [0, 1], if any."""
        key, augmentation = f"model.{self.kind}.fit.augmentation", self.augmentation
        return None if augmentation is None else partial(apply_augmentation, key, augmentation)

    @property
    def network(self) -> Any:  # noqa: ANN401
        """The network of a single sense."""
        return self.classifier.network

    @property
    def fusion(self) -> FusionLayer:
        """The fusion layer of several senses."""
        layer = self.classifier.fusion
        assert layer is not None  # a card of several senses has one
        return layer

    def train(self, mode: bool = True) -> Self:
        """Set the mode, but keep batch normalisation of FusionNet's networks in evaluation mode.

        Its statistics were trained on larger inputs, such as those of a test.
        """
        super().train(mode)
        for module in self.classifier.modules() if self.kind == FUSION else ():
            if isinstance(module, nn.modules.batchnorm._BatchNorm):
                module.eval()
        return self

    def parameter_groups(self) -> list[dict[str, Any]]:
        """Return the groups of the optimiser: ``backbone``, and ``head`` at another rate.

        The backbone is the trunk, or all of a network without a trunk; of FusionNet it is all
        networks. The head is what else is trained, at ``head_factor`` times the learning rate. A
        group without parameters is left out.
        """
        networks = [sense.network for sense in self.classifier.senses.values()]
        trunk = getattr(networks[0], "trunk", None)
        if len(networks) == 1 and isinstance(trunk, nn.Module):
            networks = [trunk]
        backbone = [*nn.ModuleList(networks).parameters()]
        slow, every = set(backbone), nn.ModuleList(self.classifier.trained_modules()).parameters()
        head = [weight for weight in every if weight not in slow]
        rate = self.fit_config["learning_rate"]
        groups = [
            {"params": backbone, "lr": rate, "name": "backbone"},
            {"params": head, "lr": rate * self.fit_config["head_factor"], "name": "head"},
        ]
        return [group for group in groups if group["params"]]

    def forward(self, *inputs: Tensor) -> Tensor:
        """Return class scores (batch, classes, fragments or tuples) of an input of each sense."""
        senses = self.classifier.senses.values()
        if self.kind != FUSION:
            (x,), (sense,) = inputs, senses
            return sense.score(x, "fc3").flatten(2)
        parts = []
        for number, (sense, x) in enumerate(zip(senses, inputs, strict=True)):
            features = sense.score(x, self.fusion.levels[number]).flatten(2)
            parts.append(self.fusion.project(number, features))
        counts, tuples = [part.shape[-1] for part in parts], None
        if max(counts) > 1:  # a network gives several positions for a piece
            positions = torch.arange(max(counts), device=parts[0].device)
            tuples = torch.stack([positions % count for count in counts], dim=1)
        return self.fusion.fuse(parts, tuples)

    def example_inputs(self) -> list[Tensor]:
        """Make an example input (1, ...) of each sense, of the size of a piece."""
        inputs = []
        for name, sense in self.classifier.senses.items():
            size, x = self.piece_sizes[name], sense.example()
            if sense.medium == "photo":
                x = sense.blank(size, size)
            elif x.shape[-1] == 1:  # a spectrogram of one frame
                x = x.repeat(*[1] * (x.dim() - 1), size)
            inputs.append(x.to(sense.device))
        return inputs

    def on_train_epoch_start(self) -> None:
        """Seed dropout by seed, epoch and process, so that a resumed run repeats it exactly."""
        torch.manual_seed(self.global_rank * APART + self.seed * 100_003 + self.current_epoch)
        self.train_accuracy.reset()

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """Return the cross entropy of all fragments against the label of their sample."""
        logits: Tensor = self(*self.inputs(batch))
        labels = batch["label"][:, None].expand(-1, logits.shape[2])
        loss = mean_loss(logits, labels, self.fit_config["label_smoothing"])
        every = self.trainer.log_every_n_steps  # type: ignore[attr-defined]  # set by a connector
        logged = (self.global_step + 1) % every == 0
        if logged or (batch_idx + 1) % REFRESH == 0:  # other steps show nothing
            share = self.train_accuracy(logits.detach().argmax(dim=1), labels)
            shown = {"train/loss": loss.detach(), "train/fragment_accuracy": share}
            self.log_dict(shown, prog_bar=True, batch_size=len(labels), sync_dist=True)
        if logged:
            for group in self.trainer.optimizers[0].param_groups:
                self.log(f"lr/{group['name']}", group["lr"], batch_size=len(labels))
        return loss

    def on_validation_epoch_start(self) -> None:
        """Begin the validation with a copy of the classifier that computes as in testing."""
        self.validation.begin(self.classifier)

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Compute the scores of a whole sample as in testing; decide on many samples later."""
        label = batch["label"]
        scores = self.validation.add(batch["recordings"], label, batch_idx)
        label = label.to(scores.device)
        loss = nn.functional.cross_entropy(scores.T, label.expand(scores.shape[1]))
        # Lightning rounds the mean number of samples of the processes down; this divides evenly
        count = self.trainer.world_size
        self.log("val/loss", loss, prog_bar=True, batch_size=count, sync_dist=True)
        if self.validation.is_full:
            self._count_decisions()

    def _count_decisions(self) -> None:
        fragments, samples = self.validation.decide()
        self.fragment_accuracy.update(*fragments)
        self.vote_accuracy.update(*samples)

    def on_validation_epoch_end(self) -> None:
        """Log the accuracies in one call: Lightning traverses a metric's state in each."""
        if self.validation.scores:
            self._count_decisions()
        self.log("val/fragment_accuracy", self.fragment_accuracy, prog_bar=True)
        self.log("val/vote_accuracy", self.vote_accuracy, prog_bar=True)

    def configure_optimizers(self) -> Any:  # noqa: ANN401  (Lightning's union of unions)
        """Make an optimiser with the groups ``backbone`` and ``head``, and its schedule.

        The schedule steps after every batch. It gets the number of steps and the largest rate of
        each group if its class takes them.

        Raises:
            UserError: If one of the two cannot be made, or is of a wrong class.
        """
        groups, fit, where = self.parameter_groups(), self.fit_config, f"model.{self.kind}.fit"
        if not groups:
            return None  # of a network that was fitted in closed form to its buffers
        offered: dict[str, Any] = {"lr": fit["learning_rate"]}  # a class may have no default of it
        weights = [weight for group in groups for weight in group["params"]]
        # one pass over the parameters; on a GPU it would keep Lightning from clipping gradients
        if all(weight.device.type == "cpu" for weight in weights) and not self._clips_unscaled:
            offered["fused"] = True
        make = build(f"{where}.optimizer", fit["optimizer"], **offered)
        optimizer = call(f"{where}.optimizer", make, groups)
        steps, rates = self._planned_steps(), [group["lr"] for group in groups]
        make_scheduler = build(
            f"{where}.schedule", fit["schedule"],
            total_steps=steps, total_iters=steps, T_max=steps, max_lr=rates,
        )  # fmt: skip
        scheduler = call(f"{where}.schedule", make_scheduler, optimizer)
        if isinstance(scheduler, ReduceLROnPlateau) or not isinstance(scheduler, LRScheduler):
            raise UserError(
                f"{where}.schedule is {type(scheduler).__name__}, which does not go by the number "
                "of the step; choose a class that does, such as torch.optim.lr_scheduler.StepLR."
            )
        keep_key(optimizer, f"{where}.optimizer")
        keep_key(scheduler, f"{where}.schedule")
        return {
            "optimizer": optimizer,
            "lr_scheduler": {"scheduler": scheduler, "interval": "step"},
        }

    def _planned_steps(self) -> int:
        """Return the number of optimiser steps that follows from the flags of the trainer.

        Lightning's ``estimated_stepping_batches`` is the same, but begins to iterate over the
        batches before a resumed run knows its epoch.
        """
        epochs: int = self.fit_config["epochs"]
        batches: int = self.fit_config["steps_per_epoch"]
        if (trainer := self._trainer) is None:
            return max(1, epochs * batches)
        limit, endless = trainer.limit_train_batches, trainer.max_epochs == -1
        batches = min(batches, limit if isinstance(limit, int) else int(batches * limit))
        batches = math.ceil(batches / trainer.accumulate_grad_batches)
        steps = batches * (epochs if endless or not trainer.max_epochs else trainer.max_epochs)
        if trainer.max_steps > 0:
            steps = trainer.max_steps if endless else min(steps, trainer.max_steps)
        return max(1, steps)

    @property
    def _clips_unscaled(self) -> bool:
        """Whether gradients are clipped under mixed precision, which no fused optimiser allows."""
        if (trainer := self._trainer) is None or not trainer.gradient_clip_val:
            return False
        return isinstance(trainer.precision_plugin, MixedPrecision)


def make_module(config: Config, card: Card) -> SurfaceModule:
    """Make the module that trains a network of the model."""
    model = config.model
    sizes = {name: model.sense(name).fit.piece for name in card.sense_names}
    return SurfaceModule(card, model.fit_values(card.kind), config.seed, sizes, config.engine)


def mean_loss(logits: Tensor, labels: Tensor, label_smoothing: float) -> Tensor:
    """Return the mean cross entropy () of scores (batch, classes, fragments).

    Args:
        logits: The scores.
        labels: (batch, fragments) class indices.
        label_smoothing: Share of every label that is spread over all classes.
    """
    if has_to_repeat(logits):  # PyTorch's repeatable loss takes (samples, classes) only
        logits, labels = logits.movedim(1, 2).flatten(0, 1), labels.flatten()
    return nn.functional.cross_entropy(logits, labels, label_smoothing=label_smoothing)


def accuracy(classes: int) -> MulticlassAccuracy:
    """Make the metric: the share of correct predictions."""
    return MulticlassAccuracy(classes, average="micro", validate_args=False)


def training_layout(classifier: nn.Module) -> torch.memory_format:
    """Return the memory layout for training: channels last, which is faster, for built-in networks.

    In it oneDNN of PyTorch 2.13 ends the process in the gradient of a convolution of kernel 1 and
    stride 2 on eight channels, which no network of this package has.
    """
    return torch.channels_last if is_builtin(classifier) else torch.contiguous_format
