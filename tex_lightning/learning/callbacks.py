"""The progress line of a training."""

import logging
from typing import Any, ClassVar

from lightning import LightningModule, Trainer
from lightning.pytorch.callbacks import ProgressBar as LightningProgressBar

from tex_lightning.core.progress import Stage
from tex_lightning.learning.base import REFRESH

log = logging.getLogger(__name__)


class ProgressBar(LightningProgressBar):
    """Epochs, loss and votes; what a validation does beside them."""

    shown: ClassVar = {
        "train/loss": "loss {:.3g}".format,
        "val/loss": "val {:.3g}".format,
        "val/vote_accuracy": "votes {:.0%}".format,
    }

    def __init__(self) -> None:
        super().__init__()
        self.epochs: Stage | None = None
        self.validation: Stage | None = None

    def disable(self) -> None:
        """Lightning asks for this where another process shows the bar; the screen knows that."""

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Begin to count, after the epochs that an earlier run has done."""
        self.epochs = Stage("epoch", trainer.max_epochs, trainer.current_epoch)

    def on_train_batch_end(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        outputs: object,
        batch: object,
        batch_idx: int,
    ) -> None:
        """Count a step."""
        last = batch_idx + 1 >= trainer.num_training_batches
        if self.epochs is not None and not last and (batch_idx + 1) % REFRESH == 0:
            part = (batch_idx + 1) / trainer.num_training_batches
            self.epochs.update(trainer.current_epoch + part, notes=self._notes(trainer))

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Count an epoch."""
        notes = self._notes(trainer)
        log.debug("Epoch %d: %s.", trainer.current_epoch + 1, ", ".join(notes))
        if self.epochs is not None:
            self.epochs.update(trainer.current_epoch + 1, notes=notes)

    def on_validation_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Show that a validation takes its time."""
        self.validation = Stage("validation", int(sum(trainer.num_val_batches)))

    def on_validation_batch_end(self, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401
        """Count a sample."""
        if self.validation is not None:
            self.validation.update(self.validation.done + 1)

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Go on with the epochs."""
        if self.validation is not None:
            self.validation.end()

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Count no more."""
        if self.epochs is not None:
            self.epochs.end()

    def on_exception(
        self, trainer: Trainer, pl_module: LightningModule, exception: BaseException
    ) -> None:
        """Count no more."""
        self.on_train_end(trainer, pl_module)

    def _notes(self, trainer: Trainer) -> list[str]:
        metrics = trainer.callback_metrics
        return [text(float(metrics[name])) for name, text in self.shown.items() if name in metrics]
