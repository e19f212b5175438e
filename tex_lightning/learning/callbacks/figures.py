"""Figures of what the network is shown, in TensorBoard."""

from typing import Any

from lightning import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback
from lightning.pytorch.loggers import TensorBoardLogger
from torch import Tensor
from torch.utils.tensorboard import SummaryWriter

from tex_lightning.features.spectrogram import HapticFeatures
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.report.figures import patch_figure, spectrogram_figure

SHOWN = 8


class SampleFigures(Callback):
    """Show sub-samples of the first training batch exactly as the network receives them."""

    def on_train_batch_start(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        batch: Any,  # noqa: ANN401  (Lightning's signature)
        batch_idx: int,
    ) -> None:
        """Draw once, at the very first step."""
        writer = tensorboard_writer(trainer) if trainer.is_global_zero else None
        if trainer.global_step or writer is None or not isinstance(pl_module, SurfaceModule):
            return
        classifier = pl_module.classifier
        titles = [classifier.card.classes[int(index)] for index in batch["label"][:SHOWN]]
        for tensor in pl_module.inputs(batch):
            name, figure = _figure(tensor[:SHOWN].cpu(), titles, classifier.haptic_features)
            writer.add_figure(name, figure, global_step=0)


def tensorboard_writer(trainer: Trainer) -> SummaryWriter | None:
    """The run's event writer, if it has one."""
    for logger in trainer.loggers:
        if isinstance(logger, TensorBoardLogger):
            writer: SummaryWriter = logger.experiment
            return writer
    return None


def _figure(tensor: Tensor, titles: list[str], features: HapticFeatures | None) -> tuple[str, Any]:
    if features is not None and tensor.shape[1] == 1:
        return "samples/spectrograms", spectrogram_figure(tensor[:, 0], titles, features)
    return "samples/patches", patch_figure(tensor, titles)
