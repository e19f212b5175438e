"""The networks, data and settings of one training."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import Trained
from tex_lightning.config import Config
from tex_lightning.data.folds import Split
from tex_lightning.data.store import Store


@dataclass(frozen=True)
class Training:
    """The networks, data and settings of one training.

    Attributes:
        card: Card of the classifier to train.
        parts: Recordings by part.
        store: Decoded files.
        directory: The run folder.
        unimodal: By sense the networks that FusionNet starts from; empty for the others.
        config: How the networks of this model are trained.
    """

    card: Card
    parts: Split
    store: Store
    directory: Path
    unimodal: dict[str, Trained]
    config: Config

    @property
    def final(self) -> Path:
        """Path of the trained checkpoint; it exists once training is finished."""
        return self.directory / "checkpoints" / f"{self.card.kind}.ckpt"

    @property
    def working(self) -> Path:
        """Folder of the checkpoints from which an interrupted run continues."""
        return self.directory / "checkpoints" / self.card.kind

    @property
    def weights(self) -> str | None:
        """Source of the trunk's first weights; None is random."""
        config = self.config
        return config.baseline_weights if self.card.baseline else config.start_of(self.card.kind)

    @property
    def fit_values(self) -> dict[str, Any]:
        """The training recipe as plain values."""
        return self.config.model.fit_values(self.card.kind)
