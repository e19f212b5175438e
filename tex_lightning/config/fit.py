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
PERTURB = (
    "perturbations to train on too, by name in tex_lightning/perturbations/severities.yaml; [] for "
    "none"
)


@dataclass
class FitConfig:
    """One network's training recipe.

    Training takes ``epochs * steps_per_epoch`` optimiser steps; an epoch is only the time between
    two checkpoints.
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
        "class and arguments of the schedule that sets the learning rate after every step",
        factory=dict,
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
        "perturbed versions of every training signal, if perturb names any perturbation",
        least=1, most=100,
    )  # fmt: skip

    @property
    def piece(self) -> int:
        """How much of a recording is trained on at once."""
        return self.frames

    piece_key: ClassVar[str] = "frames"


@dataclass
class ProbeConfig:
    """Training of VisualNet's head alone, on features of pretrained weights, before the network.

    A head without hidden layers is fitted with ``strength`` to whole photos, and to pieces of
    ``side`` pixels of large ones; other heads take ``steps`` on patches. Both make ``passes``
    passes.
    """

    steps: int = key("optimiser steps on patches; 0 leaves it out", least=0, most=1_000_000)
    passes: int = key("passes over the training photos, cut anew each time", least=1, most=1000)
    batch_size: int = key("patches in a step", **BATCH)
    learning_rate: float = key("learning rate of those steps", **RATE)
    strength: float = key(
        "inverse of regularisation of the fit for head=[]", above=0, most=1_000_000
    )
    side: int = key(
        "largest side of a photo for that fit; larger photos are cut",
        unit="pixels", least=PATCH, most=LARGEST,
    )  # fmt: skip


@dataclass
class PhotoFitConfig(FitConfig):
    """Training on square patches; FusionNet is perturbed alike."""

    patch: int = key("side of a training patch", unit="pixels", least=1, most=2048)
    rotation: float = key("largest random rotation either way", **ROTATION)
    augmentation: Any = key(
        "class, of Kornia or similar, that changes VisualNet's training patches (batch, 3, side, "
        "side) in [0, 1] after the rotation; null leaves them",
        default=None,
    )
    perturb: list[str] = key(PERTURB)
    perturbed_share: float = key(
        "share of patches that are perturbed, if perturb names any perturbation", **SHARE
    )
    probe: ProbeConfig = field(default_factory=ProbeConfig)

    @property
    def piece(self) -> int:
        """How much of a recording is trained on at once."""
        return self.patch

    piece_key: ClassVar[str] = "patch"


@dataclass
class FusionFitConfig(FitConfig):
    """Training of FusionNet on inputs as large as the receptive fields."""

    head_factor: float = key(
        "learning rate of the fusion layer over that of the networks",
        least=MIN_FACTOR, most=MAX_FACTOR,
    )  # fmt: skip
    rotation: float = key("largest random rotation of photos either way", **ROTATION)
    modality_dropout: float = key(
        "probability that a training sample is classified by one of its senses alone", **SHARE
    )
