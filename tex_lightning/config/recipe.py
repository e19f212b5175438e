"""The parts of the configuration that training, testing and prediction read."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tex_lightning.config.model import FUSION, ModelConfig
from tex_lightning.config.tasks import DecisionConfig, EngineConfig, StreamConfig, TrainerConfig


@dataclass(frozen=True)
class Running:
    """How a trained system runs and decides.

    Attributes:
        accelerator: Kind of device.
        tf32: Whether NVIDIA GPUs may round.
        engine: Fast paths.
        decision: How fragments become a label.
    """

    accelerator: str
    tf32: bool
    engine: EngineConfig
    decision: DecisionConfig


@dataclass(frozen=True)
class PredictionRecipe:
    """How files and arrays are classified.

    Attributes:
        running: How the system runs and decides.
        top_k: Number of candidates that are listed.
        file_rate: Rate in Hz of traces that carry none; None takes the checkpoint's.
        fast_decode: Whether the JPEG decoder halves photos.
        stream: How a stream votes.
    """

    running: Running
    top_k: int
    file_rate: float | None
    fast_decode: bool
    stream: StreamConfig


@dataclass(frozen=True)
class Recipe:
    """How the networks of a model are trained and recorded.

    Attributes:
        model: The networks.
        weights: Source of each trunk's first weights, by sense; None is random.
        seed: Seed of everything random.
        trainer: Device and flags of Lightning's Trainer.
        callbacks: Nodes of callbacks by name, each with its ``_target_``.
        logger: Nodes of loggers, likewise.
        num_workers: Processes that make batches.
        share: Folder of networks that systems of a family share.
        running: How they are tested.
        explained_samples: How many test samples are drawn.
        formats: File formats of figures.
        settings: The whole configuration as plain values, for loggers.
    """

    model: ModelConfig
    weights: Mapping[str, str | None]
    seed: int
    trainer: TrainerConfig
    callbacks: dict[str, Any]
    logger: dict[str, Any]
    num_workers: int
    share: str | None
    running: Running
    explained_samples: int
    formats: tuple[str, ...]
    settings: dict[str, Any]

    def start_of(self, kind: str) -> str | None:
        """Source of a network's first weights; FusionNet's branches are trained already."""
        return None if kind == FUSION else self.weights[kind]

    @property
    def baseline_weights(self) -> str | None:
        """Source of the weights of a baseline's trunk."""
        return next(filter(None, self.weights.values()), None)
