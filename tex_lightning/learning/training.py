"""What one training is about."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tex_lightning.card import Card
from tex_lightning.config import ModelConfig, TrainerConfig
from tex_lightning.data.folds import Split
from tex_lightning.data.store import Store


@dataclass(frozen=True)
class Training:
    """What one training is about.

    Attributes:
        card: Of the classifier to train.
        parts: Recordings by part.
        store: Decoded files.
        directory: The run folder.
        unimodal: By sense the checkpoints that FusionNet starts from; empty for the others.
        seed: Of everything random.
        weights: Where the trunk starts; None is at random. FusionNet's parts have started already.
        model: The networks and their recipes.
        trainer: Device and flags of Lightning's Trainer.
        callbacks: Nodes of the configuration, by name.
        logger: Likewise.
        num_workers: Processes that make batches.
    """

    card: Card
    parts: Split
    store: Store
    directory: Path
    unimodal: dict[str, Path]
    seed: int
    weights: str | None
    model: ModelConfig
    trainer: TrainerConfig
    callbacks: dict[str, Any]
    logger: dict[str, Any]
    num_workers: int

    @property
    def final(self) -> Path:
        """Where the trained checkpoint goes; its presence means that training is finished."""
        return self.directory / "checkpoints" / f"{self.card.kind}.ckpt"

    @property
    def working(self) -> Path:
        """Folder of the checkpoints that an interrupted run goes on from."""
        return self.directory / "checkpoints" / self.card.kind

    @property
    def fit_values(self) -> dict[str, Any]:
        """The training recipe as plain values."""
        return self.model.recipe(self.card.kind)
