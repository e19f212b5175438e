"""What is trained, and how."""

from dataclasses import dataclass, field
from typing import Any

from tex_lightning.config.keys import key

MIN_FACTOR, MAX_FACTOR = 10, 50  # of FusionNet's head, in the paper
PATCH = 224  # pixels a side that give one prediction on the trunks as published
LARGEST = 8192  # pixels a side

RATE = {"above": 0, "most": 10}
COUNT = {"least": 1, "most": 1_000_000}
BATCH = {"least": 1, "most": 4096}
SHARE = {"least": 0, "most": 1}
PROBABILITY = {"least": 0, "below": 1}
WIDTH = {"above": 0, "most": 8}
ROTATION = {"unit": "degrees", "least": 0, "most": 180}
NORMS = ("batch", "lrn", "none")
PERTURB = "names in tex_lightning/perturbations/severities.yaml to train on too; [] for none"


@dataclass
class FitConfig:
    """One network's training recipe.

    ``epochs * steps_per_epoch`` optimiser steps; an epoch is only the time between two
    checkpoints.
    """

    epochs: int = key("stretches of training between two checkpoints", least=0, most=1_000_000)
    steps_per_epoch: int = key("optimiser steps in an epoch", **COUNT)
    batch_size: int = key("samples in a step, over all processes", **BATCH)
    optimizer: dict[str, Any] = key(
        "class and arguments; Adam adds weight decay to the gradient, as the paper does",
        factory=dict,
    )
    learning_rate: float = key("largest learning rate of the trunk", **RATE)
    schedule: dict[str, Any] = key(
        "class and arguments of what changes the learning rate after every step", factory=dict
    )
    label_smoothing: float = key("share of the label given to all classes", **PROBABILITY)
    head_factor: float = key(
        "learning rate of the 1x1 layers over that of the trunk", above=0, most=1000
    )


@dataclass
class HapticFitConfig(FitConfig):
    """Training of HapticNet on sub-samples of spectrograms; FusionNet is perturbed alike."""

    frames: int = key(
        "length of a sub-sample; longer traces are cut at random, shorter ones repeated",
        unit="frames", least=177, most=20_000,
    )  # fmt: skip
    perturb: list[str] = key(PERTURB)
    perturbed_copies: int = key(
        "versions of every training trace beside itself, where perturb names anything",
        least=1, most=100,
    )  # fmt: skip


@dataclass
class ProbeConfig:
    """Training of VisualNet's head alone, before the whole, on features of pretrained weights.

    A head without hidden layers is fitted with ``strength`` to whole photos, of large ones to
    pieces of ``side`` pixels; others take ``steps`` on patches. Both make so many ``passes``.
    """

    steps: int = key("optimiser steps on patches; 0 leaves it out", least=0, most=1_000_000)
    passes: int = key("passes over the training photos, cut anew each time", least=1, most=1000)
    batch_size: int = key("patches in a step", **BATCH)
    learning_rate: float = key("learning rate of those steps", **RATE)
    strength: float = key(
        "inverse of regularisation of the fit that head=[] gets", above=0, most=1_000_000
    )
    side: int = key(
        "most along a side of a photo for that fit; larger ones are cut",
        unit="pixels", least=PATCH, most=LARGEST,
    )  # fmt: skip


@dataclass
class VisualFitConfig(FitConfig):
    """Training of VisualNet on square patches; FusionNet is perturbed alike."""

    patch: int = key("side of a training patch", unit="pixels", least=1, most=2048)
    rotation: float = key("largest random rotation either way", **ROTATION)
    augmentation: Any = key(
        "class, of Kornia or the like, that changes VisualNet's training patches (batch, 3, side, "
        "side) in [0, 1] after the rotation; null leaves them",
        default=None,
    )
    perturb: list[str] = key(PERTURB)
    perturbed_share: float = key(
        "share of the patches that is perturbed, where perturb names anything", **SHARE
    )
    probe: ProbeConfig = field(default_factory=ProbeConfig)


@dataclass
class FusionFitConfig(FitConfig):
    """Training of FusionNet on receptive-field-sized inputs."""

    head_factor: float = key(
        "learning rate of the fusion layer over that of the networks",
        least=MIN_FACTOR, most=MAX_FACTOR,
    )  # fmt: skip
    rotation: float = key("largest random rotation of photos either way", **ROTATION)
    modality_dropout: float = key(
        "probability that a pair is classified by its trace or its photo alone", **SHARE
    )


@dataclass
class HapticConfig:
    """HapticNet and its features."""

    width: float = key("factor on every channel count; 1 is the paper's size", **WIDTH)
    norm: str = key("normalisation of activations; lrn is the paper's", choices=NORMS)
    dropout: float = key("probability of dropping an input of the 1x1 layers", **PROBABILITY)
    normalisation: str = key(
        "of spectrograms: log per channel over the training set, or per trace to [0, 1]",
        choices=("standard", "paper"),
    )
    skip_impact: bool = key("leave out the first touch of the tool")
    axes: str = key(
        "mean removed and three axes joined per frame, or over the whole trace as in the paper",
        choices=("frame", "trace"),
    )
    scale: str = key(
        "50 mel bands up to half the sampling rate, or the paper's 50 channels up to 1 kHz",
        choices=("mel", "linear"),
    )
    fit: HapticFitConfig = field(default_factory=HapticFitConfig)


@dataclass
class VisualConfig:
    """VisualNet on one of several trunks."""

    trunk: dict[str, Any] = key(
        "class of the convolutions before FC1 and its own keys, set by model/trunk=NAME; it gets "
        "width and norm",
        factory=dict,
    )
    width: float = key("factor on every channel count; 1 is the published size", **WIDTH)
    norm: str = key(
        "normalisation of activations; none for pretrained trunks without one", choices=NORMS
    )
    dropout: float = key("probability of dropping an input of FC2 and FC3", **PROBABILITY)
    fc1_kernel: int | None = key(
        "side of FC1's kernel; null is the trunk's, which makes one prediction of 224 pixels",
        least=1, most=64, default=None,
    )  # fmt: skip
    head: list[int] = key(
        "channels of FC1 and FC2 before the width; [] for FC3 alone", least=1, most=16_384
    )
    fit: VisualFitConfig = field(default_factory=VisualFitConfig)


@dataclass
class FusionConfig:
    """FusionNet: which layer is fused and where the unimodal networks come from."""

    level: str = key("layer that is fused", choices=("fc2", "fc3"))
    haptic_checkpoint: str | None = key(
        "HapticNet to start from; null trains one first", default=None
    )
    visual_checkpoint: str | None = key(
        "VisualNet to start from; null trains one first", default=None
    )
    head_start: str = key(
        "first weights of the fusion layer: the sum of both networks' scores, or random ones as "
        "in the paper",
        choices=("scores", "random"),
    )
    fit: FusionFitConfig = field(default_factory=FusionFitConfig)


@dataclass
class ModelConfig:
    """What is trained."""

    name: str = key("model, set by model=NAME")
    kind: str = key("what it looks at, set by model=NAME", choices=("haptic", "visual", "fusion"))
    baseline: Any = key(
        "class of a system that is fitted instead of a network, and its own keys, which its file "
        "in conf/model explains",
        default=None,
    )
    budget: float = key(
        "factor on the baseline's steps, kernels and components; below 1 to try it",
        above=0, most=1000,
    )  # fmt: skip
    haptic: HapticConfig = field(default_factory=HapticConfig)
    visual: VisualConfig = field(default_factory=VisualConfig)
    fusion: FusionConfig = field(default_factory=FusionConfig)
