"""What one training is about."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tex_lightning.card import Card
from tex_lightning.config.recipe import Recipe
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
        recipe: How the networks of this model are trained.
    """

    card: Card
    parts: Split
    store: Store
    directory: Path
    unimodal: dict[str, Path]
    recipe: Recipe

    @property
    def final(self) -> Path:
        """Where the trained checkpoint goes; its presence means that training is finished."""
        return self.directory / "checkpoints" / f"{self.card.kind}.ckpt"

    @property
    def working(self) -> Path:
        """Folder of the checkpoints that an interrupted run goes on from."""
        return self.directory / "checkpoints" / self.card.kind

    @property
    def weights(self) -> str | None:
        """Where the trunk starts; None is at random."""
        recipe = self.recipe
        return recipe.baseline_weights if self.card.baseline else recipe.start_of(self.card.kind)

    @property
    def fit_values(self) -> dict[str, Any]:
        """The training recipe as plain values."""
        return self.recipe.model.fit_values(self.card.kind)
