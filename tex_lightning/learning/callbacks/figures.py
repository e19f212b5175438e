"""Figures of what the network is shown."""

from typing import Any

from lightning import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback
from matplotlib.figure import Figure
from torch import Tensor

from tex_lightning.features.spectrogram import HapticFeatures
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.loggers import log_figures
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
        first = trainer.is_global_zero and not trainer.global_step
        if not first or not isinstance(pl_module, SurfaceModule):
            return
        classifier = pl_module.classifier
        titles = [classifier.card.classes[int(index)] for index in batch["label"][:SHOWN]]
        for tensor in pl_module.inputs(batch):
            name, figure = _figure(tensor[:SHOWN].cpu(), titles, classifier.haptic_features)
            log_figures(trainer.loggers, {name: figure})


def _figure(
    tensor: Tensor, titles: list[str], features: HapticFeatures | None
) -> tuple[str, Figure]:
    if features is not None and tensor.shape[1] == 1:
        return "samples/spectrograms", spectrogram_figure(tensor[:, 0], titles, features)
    return "samples/patches", patch_figure(tensor, titles)
