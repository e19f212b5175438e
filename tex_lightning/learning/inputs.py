"""Show recordings as a network gets them: as they are, and as they are cut and changed to train."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from lightning.pytorch.loggers import Logger
from torch import Tensor

from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.data.banks import Bank, Indices, PhotoBank
from tex_lightning.data.datamodule import TrainingBatches
from tex_lightning.learning.module import SurfaceModule
from tex_lightning.report.board import Picture, jpeg, show, shows
from tex_lightning.report.pictures import input_pixels, row_of
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

SHOWN = 8  # recordings of each sense, of different classes as far as there are
MAX_FRAMES = 600  # of a long signal
MAX_PIXELS = 300  # pixels along one of them


def show_inputs(loggers: Sequence[Logger], module: SurfaceModule, batches: TrainingBatches) -> None:
    """Add pictures of training recordings before and after augmentation, the same in both.

    Before it is what a test would see of the recording: a signal whole, of a photo the piece that
    is cut. After it is what a training batch has. Nothing random of the training is changed.
    """
    if not is_rank_zero() or not shows(loggers):
        return
    pictures = []
    with torch.random.fork_rng(), torch.no_grad():
        for name, (bank, labels) in batches.banks.items():
            pictures += _of_sense(module, name, bank, labels)
    for logger in loggers:
        show(logger, "inputs", pictures)


def _of_sense(module: SurfaceModule, name: str, bank: Bank, labels: Indices) -> list[Picture]:
    sense, size = module.classifier.senses[name], module.pieces[name]
    _, first = np.unique(labels, return_index=True)
    chosen = np.sort(first)[np.linspace(0, len(first) - 1, min(SHOWN, len(first))).astype(int)]
    if isinstance(bank, PhotoBank):
        kept = replace(bank, augmentation=None, rotation=0.0)  # at the same corners
        pieces = kept.cut(chosen, np.random.default_rng(module.seed))
        before = [*sense.training_input(_on(pieces, sense.device), size)]
    else:
        before = [bank.inputs[index][..., :MAX_FRAMES] for index in chosen.tolist()]
    pieces = bank.cut(chosen, np.random.default_rng(module.seed))
    after = [*sense.training_input(_on(pieces, sense.device), size, module.change)]
    kind = "spectrograms" if isinstance(sense.features, SpectrogramFeatures) else "features"
    kind = "photos" if sense.medium == "photo" else kind
    captions = [module.classifier.card.classes[labels[index]] for index in chosen.tolist()]
    return [
        Picture(
            f"inputs/{name} {kind}, {when} augmentation",  # which sort as they are read
            jpeg(row_of([input_pixels(x, sense.features, MAX_PIXELS) for x in inputs], captions)),
        )
        for when, inputs in (("1 before", before), ("2 after", after))
    ]


def _on(pieces: dict[str, Tensor], device: torch.device) -> dict[str, Tensor]:
    return {key: value.to(device) for key, value in pieces.items()}
