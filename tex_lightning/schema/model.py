"""What is trained, and how."""

from dataclasses import dataclass, field
from typing import Any

from omegaconf import MISSING


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
    """Training of HapticNet on sub-samples of ``frames`` spectrogram frames.

    With names of perturbations in ``perturb``, every trace is there in ``perturbed_copies`` more
    versions, each changed by one of them; FusionNet is trained on the same.
    """

    frames: int = MISSING
    perturb: list[str] = MISSING
    perturbed_copies: int = MISSING


@dataclass
class ProbeConfig:
    """Training of VisualNet's head alone, before the whole, on features of pretrained weights.

    A head without hidden layers is fitted with ``strength`` to whole photos, of large ones to
    pieces of ``side`` pixels; others take ``steps`` on patches. Both make so many ``passes``.
    """

    steps: int = MISSING
    passes: int = MISSING
    batch_size: int = MISSING
    learning_rate: float = MISSING
    strength: float = MISSING
    side: int = MISSING


@dataclass
class VisualFitConfig(FitConfig):
    """Training of VisualNet on square patches, rotated by up to ``rotation`` degrees.

    With names of perturbations in ``perturb``, a ``perturbed_share`` of the patches is changed by
    one of them each; FusionNet is trained on the same.
    """

    patch: int = MISSING
    rotation: float = MISSING
    perturb: list[str] = MISSING
    perturbed_share: float = MISSING
    probe: ProbeConfig = field(default_factory=ProbeConfig)


@dataclass
class FusionFitConfig(FitConfig):
    """Training of FusionNet on receptive-field-sized inputs, photos rotated as above.

    With a probability of ``modality_dropout``, the trace or the photo of a pair says nothing.
    """

    rotation: float = MISSING
    modality_dropout: float = MISSING


@dataclass
class HapticConfig:
    """HapticNet and its features."""

    width: float = MISSING
    norm: str = MISSING
    dropout: float = MISSING
    normalisation: str = MISSING
    skip_impact: bool = MISSING
    axes: str = MISSING
    scale: str = MISSING
    fit: HapticFitConfig = field(default_factory=HapticFitConfig)


@dataclass
class VisualConfig:
    """VisualNet; ``head`` holds the channel counts of FC1 and FC2, or nothing.

    ``fragment`` is the side in pixels of what gives one prediction.
    """

    trunk: str = MISSING
    width: float = MISSING
    norm: str = MISSING
    dropout: float = MISSING
    fc1_kernel: int | None = None
    head: list[int] = MISSING
    fragment: int | None = None
    fit: VisualFitConfig = field(default_factory=VisualFitConfig)


@dataclass
class FusionConfig:
    """FusionNet: which layer is fused and where the unimodal networks come from."""

    level: str = MISSING
    haptic_checkpoint: str | None = None
    visual_checkpoint: str | None = None
    head_start: str = MISSING
    fit: FusionFitConfig = field(default_factory=FusionFitConfig)


@dataclass
class ModelConfig:
    """What is trained; ``kind`` is haptic, visual or fusion.

    ``baseline`` names a system of ``tex_lightning.baselines`` that is fitted instead of a network,
    with ``settings`` of its own, whose budgets are multiplied by ``budget``.
    """

    name: str = MISSING
    kind: str = MISSING
    baseline: str | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    budget: float = MISSING
    haptic: HapticConfig = field(default_factory=HapticConfig)
    visual: VisualConfig = field(default_factory=VisualConfig)
    fusion: FusionConfig = field(default_factory=FusionConfig)
