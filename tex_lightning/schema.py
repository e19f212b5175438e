"""The configuration, typed: a wrong key or type fails while it is composed.

Values live in ``conf/``; here stand their types and meaning only. ``???`` (``MISSING``) marks what
a configuration file or the user has to fill in.
"""

from dataclasses import dataclass, field
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING


@dataclass
class SyntheticConfig:
    """Synthetic surfaces: recordings per class, their seed and size (seconds, pixels)."""

    recordings: int = MISSING
    seed: int = MISSING
    seconds: float = MISSING
    photo_width: int = MISSING
    photo_height: int = MISSING


@dataclass
class DataConfig:
    """Where recordings come from, how they are decoded and divided into folds."""

    name: str = MISSING
    root: str | None = MISSING
    manifest: str | None = MISSING
    classes: int | None = None
    synthetic: SyntheticConfig = field(default_factory=SyntheticConfig)
    sampling_rate: float = MISSING
    file_rate: float | None = None
    half_scale: bool = MISSING
    folds: int = MISSING
    test_fold: int | None = MISSING
    val_fold: int | None = None
    cache_dir: str | None = None
    num_workers: int = MISSING


@dataclass
class FitConfig:
    """One network's training recipe.

    ``epochs * steps_per_epoch`` optimiser steps; an epoch is only the time between two
    checkpoints.
    """

    epochs: int = MISSING
    steps_per_epoch: int = MISSING
    batch_size: int = MISSING
    optimizer: str = MISSING
    learning_rate: float = MISSING
    schedule: str = MISSING
    gamma: float = MISSING
    step_every: int = MISSING
    weight_decay: float = MISSING
    label_smoothing: float = MISSING
    head_factor: float = MISSING


@dataclass
class HapticFitConfig(FitConfig):
    """Training of HapticNet on sub-samples of ``frames`` spectrogram frames."""

    frames: int = MISSING


@dataclass
class VisualFitConfig(FitConfig):
    """Training of VisualNet on square patches, rotated by up to ``rotation`` degrees."""

    patch: int = MISSING
    rotation: float = MISSING


@dataclass
class FusionFitConfig(FitConfig):
    """Training of FusionNet on receptive-field-sized inputs, photos rotated as above."""

    rotation: float = MISSING


@dataclass
class HapticConfig:
    """HapticNet and its features."""

    width: float = MISSING
    norm: str = MISSING
    dropout: float = MISSING
    normalisation: str = MISSING
    skip_impact: bool = MISSING
    axes: str = MISSING
    fit: HapticFitConfig = field(default_factory=HapticFitConfig)


@dataclass
class VisualConfig:
    """VisualNet."""

    trunk: str = MISSING
    width: float = MISSING
    norm: str = MISSING
    dropout: float = MISSING
    fc1_kernel: int | None = None
    fit: VisualFitConfig = field(default_factory=VisualFitConfig)


@dataclass
class FusionConfig:
    """FusionNet: which layer is fused and where the unimodal networks come from."""

    level: str = MISSING
    haptic_checkpoint: str | None = None
    visual_checkpoint: str | None = None
    fit: FusionFitConfig = field(default_factory=FusionFitConfig)


@dataclass
class ModelConfig:
    """What is trained; ``kind`` is haptic, visual or fusion."""

    name: str = MISSING
    kind: str = MISSING
    haptic: HapticConfig = field(default_factory=HapticConfig)
    visual: VisualConfig = field(default_factory=VisualConfig)
    fusion: FusionConfig = field(default_factory=FusionConfig)


@dataclass
class DecisionConfig:
    """Max voting; ``pairs`` is FusionNet's K, drawn from a generator seeded with ``seed``."""

    pairs: int = MISSING
    seed: int = MISSING


@dataclass
class TrainerConfig:
    """Passed to Lightning's Trainer; ``threads`` None leaves PyTorch's choice."""

    accelerator: str = MISSING
    precision: str = MISSING
    threads: int | None = None


@dataclass
class LoggerConfig:
    """Whether TensorBoard events and their figures are written beside the CSV of metrics."""

    tensorboard: bool = MISSING


@dataclass
class CrossvalConfig:
    """Which folds are run; None means all."""

    only: list[int] | None = None


@dataclass
class PredictConfig:
    """Whether task=predict lets the JPEG decoder halve photos, faster and nearly the same."""

    fast_decode: bool = MISSING


@dataclass
class GenerateConfig:
    """Where synthetic surfaces are written out and in which layout (folder or tum)."""

    out: str = MISSING
    layout: str = MISSING


@dataclass
class Config:
    """The whole configuration."""

    task: str = MISSING
    seed: int = MISSING
    checkpoint: str | None = MISSING
    haptic: Any = None
    image: Any = None
    top_k: int = MISSING
    weights: str | None = None
    data: DataConfig = field(default_factory=DataConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    decision: DecisionConfig = field(default_factory=DecisionConfig)
    trainer: TrainerConfig = field(default_factory=TrainerConfig)
    logger: LoggerConfig = field(default_factory=LoggerConfig)
    crossval: CrossvalConfig = field(default_factory=CrossvalConfig)
    predict: PredictConfig = field(default_factory=PredictConfig)
    generate: GenerateConfig = field(default_factory=GenerateConfig)


def flatten(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested plain values as one dictionary with dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, dict):
            flat.update(flatten(value, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def register() -> None:
    """Make the schema known to Hydra under the name ``schema``."""
    ConfigStore.instance().store(name="schema", node=Config)
