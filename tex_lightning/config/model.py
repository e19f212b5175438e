"""The model: its senses, networks and fusion."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from tex_lightning.config.fit import (
    NORMS,
    PROBABILITY,
    WIDTH,
    FusionFitConfig,
    PhotoFitConfig,
    SignalFitConfig,
)
from tex_lightning.config.keys import key

FUSION = "fusion"  # name of several senses together
PACKAGE_SENSES = ("haptic", "visual", "sound")  # senses of the package; others are a user's


@dataclass
class SenseConfig:
    """One sense.

    The keys beside ``fit`` form a node, which a card keeps and from which a branch is built. Its
    classes receive the keys that they have parameters for.
    """

    _target_: str = key("class of the branch: of signals or of photos")
    modality: str = key(
        "modality of its recordings in the table of recordings, and of files to predict from"
    )
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
        "of spectrograms: logarithms standardised per channel over the training set, or the "
        "paper's scaling per trace to [0, 1]",
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
    window_seconds: float = key(
        "length of a frame of the spectrogram", unit="s", least=0.001, most=10
    )
    hop_seconds: float = key("time from frame to frame", unit="s", least=0.0001, most=10)
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
class CustomSignalConfig(SenseConfig):
    """A user's sense of signals."""

    fit: SignalFitConfig = field(default_factory=SignalFitConfig)


@dataclass
class CustomPhotoConfig(SenseConfig):
    """A user's sense of photos."""

    fit: PhotoFitConfig = field(default_factory=PhotoFitConfig)


@dataclass
class FusionConfig:
    """FusionNet: which layer is fused and where the unimodal networks come from.

    A user's sense has its ``NAME_checkpoint`` too.
    """

    level: str = key("layer that is fused", choices=("fc2", "fc3"))
    haptic_checkpoint: str | None = key(
        "HapticNet to start from; null trains one first", default=None
    )
    visual_checkpoint: str | None = key(
        "VisualNet to start from; null trains one first", default=None
    )
    sound_checkpoint: str | None = key(
        "network of sounds to start from; null trains one first", default=None
    )
    head_start: str = key(
        "first weights of the fusion layer: the sum of all networks' scores, or random ones as "
        "in the paper",
        choices=("scores", "random"),
    )
    fit: FusionFitConfig = field(default_factory=FusionFitConfig)

    def checkpoint(self, sense: str) -> str | None:
        """The checkpoint that the network of a sense starts from; None if there is none."""
        given: str | None = getattr(self, f"{sense}_checkpoint", None)
        return given


@dataclass
class ModelConfig:
    """The model that is trained; a user's own senses are attributes too."""

    name: str = key("model, set by model=NAME")
    senses: list[str] = key(
        "branches: haptic, visual, sound or your own; several are trained one by one, then fused"
    )
    baseline: Any = key(
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
        return [name for name, each in vars(self).items() if isinstance(each, SenseConfig)]

    @property
    def nodes(self) -> list[Any]:
        """What a card keeps of it: the nodes of its baseline and of its senses."""
        return [self.baseline, *(self.sense(name).node for name in self.senses)]

    @property
    def checkpoints(self) -> dict[str, str]:
        """Checkpoints that the fused networks start from, by sense; absent where none is given."""
        given = {name: self.fusion.checkpoint(name) for name in self.senses}
        fused = self.kind == FUSION
        return {name: path for name, path in given.items() if fused and path is not None}

    @property
    def trained(self) -> list[str]:
        """Networks to train, in this order: of senses without a checkpoint, then of all senses."""
        alone = [name for name in self.senses if name not in self.checkpoints]
        return list(dict.fromkeys([*alone, self.kind]))

    @property
    def modalities(self) -> tuple[str, ...]:
        """Modalities of the recordings that it reads, each once."""
        return tuple(dict.fromkeys(self.sense(name).modality for name in self.senses))

    def sense(self, sense: str) -> "SenseConfig":
        """The configuration of one sense."""
        found: SenseConfig = getattr(self, sense)
        return found

    def fit_values(self, kind: str) -> dict[str, Any]:
        """Training settings of one sense's network, or of ``fusion``, as plain values."""
        return asdict(getattr(self, kind).fit)


def kind_of(senses: Sequence[str]) -> str:
    """Name of a network of these senses."""
    return senses[0] if len(senses) == 1 else FUSION
