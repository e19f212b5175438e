"""Figures of the network's training inputs."""

from typing import Any

from lightning import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback
from matplotlib.figure import Figure
from torch import Tensor

from tex_lightning.learning.base import SurfaceModule
from tex_lightning.learning.loggers import log_figures
from tex_lightning.report.figures import patch_figure, spectrogram_figure
from tex_lightning.senses import Sense

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
        inputs = zip(classifier.senses.items(), pl_module.inputs(batch), strict=True)
        for (name, sense), tensor in inputs:
            figure = _figure(sense, tensor[:SHOWN].cpu(), titles)
            log_figures(trainer.loggers, {f"samples/{name}": figure})


def _figure(sense: Sense, inputs: Tensor, titles: list[str]) -> Figure:
    """Patches of photos, or of signals the planes of their features one above the other."""
    if sense.medium == "photo":
        return patch_figure(inputs, titles)
    planes = inputs.reshape(len(inputs), -1, inputs.shape[-1])
    return spectrogram_figure(planes, titles, sense.features)
