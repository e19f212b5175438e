"""Decoded recordings as tensors."""

import numpy as np
import torch
from torch import Tensor

from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store


def load_recording(row: Recording, store: Store) -> Tensor:
    """A decoded recording, copied to memory."""
    return torch.from_numpy(np.array(store.load(row)))


def load_sample(sample: Sample, store: Store) -> dict[str, Tensor]:
    """Decoded recordings of a sample by modality, copied to memory."""
    return {name: load_recording(row, store) for name, row in sample.recordings.items()}
