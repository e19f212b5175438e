"""What one training is about."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tex_lightning.card import Card
from tex_lightning.config import Config
from tex_lightning.data.folds import Kind, Split
from tex_lightning.data.generator import SpecimenGenerator
from tex_lightning.data.store import Store


@dataclass(frozen=True)
class Training:
    """What one training is about.

    Attributes:
        config: The whole configuration.
        card: Of the classifier to train.
        parts: Recordings by part.
        store: Decoded files.
        directory: The run folder.
        unimodal: Checkpoints that FusionNet starts from; empty for the others.
        stream: Specimens to train on in place of recordings.
    """

    config: Config
    card: Card
    parts: Split
    store: Store
    directory: Path
    unimodal: dict[Kind, Path]
    stream: SpecimenGenerator | None = None

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
        """Where the trunk starts; FusionNet's parts have done so already."""
        return None if self.card.kind == "fusion" else self.config.weights_of(self.card.kind)

    @property
    def fit_values(self) -> dict[str, Any]:
        """The training recipe as plain values."""
        return asdict(getattr(self.config.model, self.card.kind).fit)
