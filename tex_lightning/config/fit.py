"""How networks are trained."""

from dataclasses import dataclass, field
from typing import Any, ClassVar

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
class SignalFitConfig(FitConfig):
    """Training on sub-samples of spectrograms; FusionNet is perturbed alike."""

    frames: int = key(
        "length of a sub-sample; longer signals are cut at random, shorter ones repeated",
        unit="frames", least=1, most=20_000,
    )  # fmt: skip
    perturb: list[str] = key(PERTURB)
    perturbed_copies: int = key(
        "versions of every training signal beside itself, where perturb names anything",
        least=1, most=100,
    )  # fmt: skip

    @property
    def piece(self) -> int:
        """How much of a recording is trained on at once."""
        return self.frames

    piece_key: ClassVar[str] = "frames"


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
class PhotoFitConfig(FitConfig):
    """Training on square patches; FusionNet is perturbed alike."""

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

    @property
    def piece(self) -> int:
        """How much of a recording is trained on at once."""
        return self.patch

    piece_key: ClassVar[str] = "patch"


@dataclass
class FusionFitConfig(FitConfig):
    """Training of FusionNet on receptive-field-sized inputs."""

    head_factor: float = key(
        "learning rate of the fusion layer over that of the networks",
        least=MIN_FACTOR, most=MAX_FACTOR,
    )  # fmt: skip
    rotation: float = key("largest random rotation of photos either way", **ROTATION)
    modality_dropout: float = key(
        "probability that a training sample is classified by one of its senses alone", **SHARE
    )
