"""Batches of network inputs and labels, for training loops of one's own."""

from collections.abc import Sequence
from typing import Any

import torch

from tex_lightning.data.datamodule import Batch, SampleSet, SurfaceData
from tex_lightning.learning.base import SurfaceModule


class InputData(SurfaceData):
    """Network inputs and class indices of one fold, for any Lightning Trainer.

    A batch is a pair of inputs and labels (batch,) int64. Inputs are a tensor, of several senses a
    dictionary of tensors by sense: spectrograms (batch, 1, 50, frames), photos (batch, 3, height,
    width) normalised, or what the features of a sense of your own give. Training batches hold
    ``batch_size`` random pieces; validation and test batches hold one whole recording each.

    Args:
        data: Batches and samples before features.
        module: The untrained network of the composed model, whose features are used.

    Attributes:
        classes: Class names, in the order of the labels.
        classifier: The untrained classifier of the composed model.
    """

    def __init__(self, data: SurfaceData, module: SurfaceModule) -> None:
        super().__init__(data.batches, data.steps, data.validation, data.test, data.num_workers)
        self.classifier = module.classifier
        self.classes = module.classifier.card.classes
        self._cut_inputs = module.inputs

    def train_dataloader(self) -> Any:  # noqa: ANN401
        """Return an iterable over one epoch."""
        loader: Any = super().train_dataloader()
        loader.collate_fn = self._pieces
        return loader

    def _whole(self, samples: SampleSet | None) -> Any:  # noqa: ANN401
        loader: Any = super()._whole(samples)
        if samples:
            loader.collate_fn = self._recording
        return loader

    @torch.no_grad()
    def _pieces(self, batch: Batch) -> tuple[Any, torch.Tensor]:
        return self._by_sense(self._cut_inputs(batch)), batch["label"]

    @torch.no_grad()
    def _recording(self, batch: Batch) -> tuple[Any, torch.Tensor]:
        senses = self.classifier.senses.values()
        inputs = [sense(batch["recordings"][sense.modality]) for sense in senses]
        return self._by_sense(inputs), batch["label"][None]

    def _by_sense(self, inputs: Sequence[torch.Tensor]) -> Any:  # noqa: ANN401
        if len(inputs) == 1:
            return inputs[0]
        return dict(zip(self.classifier.senses, inputs, strict=True))
