"""The model: its senses, networks and fusion, and how each of them is trained."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

from tex_lightning.config.keys import key

FUSION = "fusion"  # name of several senses together
PACKAGE_SENSES = ("haptic", "visual", "sound")  # senses of the package; others are a user's
CHECKPOINT = "_checkpoint"  # end of a key of the fusion
MIN_FACTOR, MAX_FACTOR = 10, 50  # of FusionNet's head, in the paper
PATCH = 224  # pixels a side that give one prediction on the trunks as published
LARGEST = 8192  # pixels a side
RATE = {"above": 0, "most": 10}
COUNT = {"least": 1, "most": 1_000_000}
STEPS = {"least": 0, "most": 1_000_000}
BATCH = {"least": 1, "most": 4096}
SHARE = {"least": 0, "most": 1}
PROBABILITY = {"least": 0, "below": 1}
WIDTH = {"above": 0, "most": 8}
ROTATION = {"unit": "degrees", "least": 0, "most": 180}
SECONDS = {"unit": "s", "most": 10}
NORMS = ("batch", "lrn", "none")
PERTURB = "perturbations to train on too, named in tex_lightning/perturbations/severities.yaml"


@dataclass
class FitConfig:
    """One network's training recipe.

    Training takes ``epochs * steps_per_epoch`` optimiser steps; an epoch is only the time between
    two checkpoints.
    """

    epochs: int = key("stretches of training between two checkpoints", **STEPS)
    steps_per_epoch: int = key("optimiser steps in an epoch", **COUNT)
    batch_size: int = key("samples in a step, over all processes", **BATCH)
    optimizer: dict[str, Any] = key(
        "class and arguments; Adam adds weight decay to the gradient, as the paper does",
        factory=dict,
    )
    learning_rate: float = key("largest learning rate of the trunk", **RATE)
    schedule: dict[str, Any] = key("class and arguments; it acts after every step", factory=dict)
    label_smoothing: float = key("share of the label given to all classes", **PROBABILITY)
    head_factor: float = key(
        "learning rate of the 1x1 layers over that of the trunk", above=0, most=1000
    )

    piece_key: ClassVar[str] = ""

    @property
    def piece(self) -> int:
        """How much of a recording is trained on at once."""
        size: int = getattr(self, self.piece_key)
        return size


@dataclass
class SignalFitConfig(FitConfig):
    """Training on sub-samples of spectrograms; FusionNet is perturbed alike."""

    frames: int = key(
        "frames of a sub-sample; longer signals are cut at random, shorter ones repeated",
        least=1, most=20_000,
    )  # fmt: skip
    perturb: list[str] = key(PERTURB)
    perturbed_copies: int = key("perturbed versions of every signal", least=1, most=100)

    piece_key: ClassVar[str] = "frames"


@dataclass
class ProbeConfig:
    """Fit of VisualNet's FC3 to the features of whole photos, where ``head`` is empty."""

    passes: int = key("passes over the training photos, cut anew each time", least=1, most=1000)
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
    augmentation: dict[str, Any] | None = key(
        "class, of Kornia or similar, that changes VisualNet's training patches (batch, 3, side, "
        "side) in [0, 1] after the rotation; null leaves them",
        default=None,
    )
    perturb: list[str] = key(PERTURB)
    perturbed_share: float = key("share of patches that are perturbed", **SHARE)
    probe: ProbeConfig = field(default_factory=ProbeConfig)

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


@dataclass
class SenseConfig:
    """One sense; a user's own has ``fit`` of the kind of its recordings.

    The keys beside ``fit`` form a node, which a card keeps and from which a branch is built. Its
    classes receive the keys that they have parameters for.
    """

    _target_: str = key("class of the branch: of signals or of photos")
    modality: str = key("modality of its recordings, and of files to predict from")
    decode: dict[str, Any] = key("how files are decoded", factory=dict)
    features: dict[str, Any] = key(
        "class that turns a decoded recording into network input, and its own keys", factory=dict
    )
    network: dict[str, Any] = key("class of the network, and its own keys", factory=dict)
    fit: Any = None

    @property
    def node(self) -> dict[str, Any]:
        """Plain values from which the sense is built, including a user's own keys."""
        return {name: value for name, value in vars(self).items() if name != "fit"}


@dataclass
class SignalConfig(SenseConfig):
    """HapticNet on spectrograms of traces or sounds."""

    width: float = key("factor on every channel count; 1 is the paper's size", **WIDTH)
    norm: str = key("normalisation of activations; lrn is the paper's", choices=NORMS)
    dropout: float = key("probability of dropping an input of the 1x1 layers", **PROBABILITY)
    normalisation: str = key(
        "of spectrograms: logarithms standardised over the training set, or each trace to [0, 1]",
        choices=("standard", "paper"),
    )
    skip_impact: bool = key("leave out the first touch of the tool")
    axes: str = key(
        "remove the mean and join three axes per frame, or over the whole trace as in the paper",
        choices=("frame", "trace"),
    )
    scale: str = key(
        "50 mel bands up to half the sampling rate, or the paper's 50 channels up to 1 kHz",
        choices=("mel", "linear"),
    )
    window_seconds: float = key("length of a frame of the spectrogram", least=0.001, **SECONDS)
    hop_seconds: float = key("time from frame to frame", least=0.0001, **SECONDS)
    fit: SignalFitConfig = field(default_factory=SignalFitConfig)


@dataclass
class PhotoConfig(SenseConfig):
    """VisualNet on one of several trunks."""

    trunk: dict[str, Any] = key(
        "class of the convolutions before FC1 and its own keys, set by trunk=NAME; it gets width "
        "and norm",
        factory=dict,
    )
    width: float = key("factor on every channel count; 1 is the published size", **WIDTH)
    norm: str = key(
        "normalisation of activations; none for pretrained trunks without one", choices=NORMS
    )
    dropout: float = key("probability of dropping an input of FC2 and FC3", **PROBABILITY)
    fc1_kernel: int | None = key(
        "side of FC1's kernel; null is the trunk's, with which 224 pixels give one prediction",
        least=1, most=64, default=None,
    )  # fmt: skip
    head: list[int] = key(
        "channels of FC1 and FC2 before the width; [] for FC3 alone", least=1, most=16_384
    )
    fit: PhotoFitConfig = field(default_factory=PhotoFitConfig)


@dataclass
class FusionConfig:
    """FusionNet: which layer is fused and where the unimodal networks come from.

    A user's sense has its ``NAME_checkpoint`` too.
    """

    level: str = key("layer that is fused", choices=("fc2", "fc3"))
    haptic_checkpoint: str | None = key("HapticNet to start from; null trains one", default=None)
    visual_checkpoint: str | None = key("VisualNet to start from; null trains one", default=None)
    sound_checkpoint: str | None = key("sound network; null trains one", default=None)
    head_start: str = key(
        "first weights of the fusion layer: the sum of all networks' scores, or random ones as "
        "in the paper",
        choices=("scores", "random"),
    )
    fit: FusionFitConfig = field(default_factory=FusionFitConfig)


@dataclass
class ModelConfig:
    """The model that is trained; a user's own senses are attributes too."""

    name: str = key("model, set by model=NAME")
    senses: list[str] = key(
        "branches: haptic, visual, sound or your own; several are trained one by one, then fused"
    )
    baseline: dict[str, Any] | None = key(
        "class of a system that is fitted instead of a network, and its own keys, explained in "
        "its file in conf/model",
        default=None,
    )
    budget: float = key(
        "factor on the steps of a baseline or of a sense of your own; below 1 to try it",
        above=0, most=1000,
    )  # fmt: skip
    haptic: SignalConfig = field(default_factory=SignalConfig)
    visual: PhotoConfig = field(default_factory=PhotoConfig)
    sound: SignalConfig = field(default_factory=SignalConfig)
    fusion: FusionConfig = field(default_factory=FusionConfig)

    @property
    def kind(self) -> str:
        """Name of the network: its sense, or ``fusion`` for several."""
        return kind_of(self.senses)

    @property
    def known(self) -> list[str]:
        """Names of all senses that are configured."""
        return [name for name, section in vars(self).items() if isinstance(section, SenseConfig)]

    @property
    def nodes(self) -> list[Any]:
        """What a card keeps of it: the nodes of its baseline and of its senses."""
        return [self.baseline, *(self.sense(name).node for name in self.senses)]

    @property
    def checkpoints(self) -> dict[str, str]:
        """Checkpoints that the fused networks start from, by sense; absent where none is given."""
        senses = self.senses if self.kind == FUSION else ()
        paths = {name: getattr(self.fusion, f"{name}{CHECKPOINT}", None) for name in senses}
        return {name: path for name, path in paths.items() if path is not None}

    @property
    def trained(self) -> list[str]:
        """Networks to train, in this order: of senses without a checkpoint, then of all senses."""
        alone = [name for name in self.senses if name not in self.checkpoints]
        return list(dict.fromkeys([*alone, self.kind]))

    @property
    def modalities(self) -> tuple[str, ...]:
        """Modalities of the recordings that it reads, each once."""
        return tuple(dict.fromkeys(self.sense(name).modality for name in self.senses))

    def sense(self, sense: str) -> SenseConfig:
        """The configuration of one sense."""
        section: SenseConfig = getattr(self, sense)
        return section

    def fit_values(self, kind: str) -> dict[str, Any]:
        """Training settings of one sense's network, or of ``fusion``, as plain values."""
        return asdict(getattr(self, kind).fit)


def kind_of(senses: Sequence[str]) -> str:
    """Name of a network of these senses."""
    return senses[0] if len(senses) == 1 else FUSION
