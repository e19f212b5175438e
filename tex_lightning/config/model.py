"""The model: its senses, networks and fusion, and how each of them is trained."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

from tex_lightning.config.keys import key

FUSION = "fusion"  # name of several senses together
PACKAGE_SENSES = ("haptic", "visual", "sound")  # senses of the package; others are a user's
CHECKPOINT = "_checkpoint"  # end of a key of the fusion
LARGEST = 8192  # pixels a side
RATE = "(0, 10]"
BATCH = "[1, 4096]"
PROBABILITY = "[0, 1)"
WIDTH = "(0, 8]"
ROTATION = {"range": "[0, 180]", "unit": "degrees"}
AXES = ("frame", "trace")
HEAD_STARTS = ("scores", "random")
NORMS = ("batch", "lrn", "none")
PERTURB = "perturbations to train on too, named in tex_lightning/perturbations/severities.yaml"


@dataclass
class FitConfig:
    """One network's training recipe.

    Training takes ``epochs * steps_per_epoch`` optimiser steps; an epoch is only the time between
    two checkpoints.
    """

    epochs: int = key("number of epochs; each ends with a checkpoint", "[0, 1000000]")
    steps_per_epoch: int = key("optimiser steps in an epoch", "[1, 1000000]")
    batch_size: int = key("samples in a step, over all processes", BATCH)
    optimizer: dict[str, Any] = key("class and arguments of the optimiser", factory=dict)
    learning_rate: float = key("largest learning rate of the trunk", RATE)
    schedule: dict[str, Any] = key(
        "class and arguments of the schedule, applied after every step", factory=dict
    )
    label_smoothing: float = key("share of the target that is spread over all classes", PROBABILITY)
    head_factor: float = key("learning rate of the 1x1 layers over that of the trunk", "(0, 1000]")

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
        "frames of a sub-sample; longer signals are cut at random, shorter repeated", "[1, 20000]"
    )
    perturb: list[str] = key(PERTURB)
    perturbed_copies: int = key("perturbed versions of every signal", "[1, 100]")

    piece_key: ClassVar[str] = "frames"


@dataclass
class ProbeConfig:
    """Fit of VisualNet's FC3 to the features of whole photos, where ``head`` is empty."""

    passes: int = key("passes over the training photos, each with new crops", "[1, 1000]")
    strength: float = key("inverse of the regularisation", "(0, 1000000]")
    side: int = key("largest side; larger photos are cut", f"[224, {LARGEST}]", unit="pixels")


@dataclass
class PhotoFitConfig(FitConfig):
    """Training on square patches; FusionNet is perturbed alike."""

    patch: int = key("side of a training patch", "[1, 2048]", unit="pixels")
    rotation: float = key("largest random rotation either way", **ROTATION)
    augmentation: Any = key(  # OmegaConf cannot merge a dictionary into a typed null
        "class that changes training patches (batch, 3, side, side) in [0, 1]", default=None
    )
    perturb: list[str] = key(PERTURB)
    perturbed_share: float = key("share of patches that are perturbed", "[0, 1]")
    probe: ProbeConfig = field(default_factory=ProbeConfig)

    piece_key: ClassVar[str] = "patch"


@dataclass
class FusionFitConfig(FitConfig):
    """Training of FusionNet, on inputs as large as the receptive fields."""

    head_factor: float = key(
        "learning rate of the fusion layer over that of the networks, as the paper", "[10, 50]"
    )
    rotation: float = key("largest random rotation of photos", **ROTATION)


@dataclass
class SenseConfig:
    """One sense; a user's own has ``fit`` of the kind of its recordings.

    The keys beside ``fit`` form a node, which a card keeps and from which a sense is built. Its
    classes receive the keys that they have parameters for.
    """

    _target_: str = key("class of the sense: of signals or of photos")
    modality: str = key("modality of its recordings, and of files to predict from")
    decode: dict[str, Any] = key("how files are decoded", factory=dict)
    features: dict[str, Any] = key(
        "class from decoded recording to network input, and its keys", factory=dict
    )
    network: dict[str, Any] = key("class of the network, and its keys", factory=dict)
    fit: Any = None

    @property
    def node(self) -> dict[str, Any]:
        """Plain values from which the sense is built, including a user's own keys."""
        return {name: value for name, value in vars(self).items() if name != "fit"}


@dataclass
class SignalConfig(SenseConfig):
    """HapticNet on spectrograms of traces or sounds."""

    width: float = key("factor on every channel count; 1 is the paper's size", WIDTH)
    norm: str = key("normalisation of activations; lrn is the paper's", choices=NORMS)
    dropout: float = key("probability of dropping an input of the 1x1 layers", PROBABILITY)
    normalisation: str = key(
        "standardised logarithms, or each trace to [0, 1]", choices=("standard", "paper")
    )
    skip_impact: bool = key("leave out the first touch of the tool")
    axes: str = key(
        "join three axes per frame, or over the whole trace as in the paper", choices=AXES
    )
    scale: str = key(
        "50 mel bands, or the paper's 50 channels up to 1 kHz", choices=("mel", "linear")
    )
    window_seconds: float = key("length of a frame of the spectrogram", "[0.001, 10]", unit="s")
    hop_seconds: float = key("time from frame to frame", "[0.0001, 10]", unit="s")
    fit: SignalFitConfig = field(default_factory=SignalFitConfig)


@dataclass
class PhotoConfig(SenseConfig):
    """VisualNet on one of several trunks."""

    trunk: dict[str, Any] = key("class of the convolutions before FC1, and its keys", factory=dict)
    width: float = key("factor on every channel count; 1 is the published size", WIDTH)
    norm: str = key("normalisation of activations; none for pretrained trunks", choices=NORMS)
    dropout: float = key("probability of dropping an input of FC2 and FC3", PROBABILITY)
    fc1_kernel: int | None = key("side of FC1's kernel; null: the trunk's", "[1, 64]", default=None)
    head: list[int] = key("channels of FC1 and FC2 before the width; []: FC3 alone", "[1, 16384]")
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
        "first weights of the fusion layer: the sum of all scores, or random", choices=HEAD_STARTS
    )
    fit: FusionFitConfig = field(default_factory=FusionFitConfig)


@dataclass
class ModelConfig:
    """The model that is trained; a user's own senses are attributes too."""

    name: str = key("model, set by model=NAME")
    senses: list[str] = key(
        "haptic, visual, sound or a custom sense; several are trained, then fused"
    )
    baseline: Any = key(  # not a typed null, as PhotoFitConfig.augmentation
        "class of the baseline in place of a network, and its keys", default=None
    )
    budget: float = key("factor on the steps of a baseline or of a custom sense", "(0, 1000]")
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
        """Return the configuration of one sense."""
        section: SenseConfig = getattr(self, sense)
        return section

    def fit_values(self, kind: str) -> dict[str, Any]:
        """Return training settings of one sense's network, or of ``fusion``, as plain values."""
        return asdict(getattr(self, kind).fit)


def kind_of(senses: Sequence[str]) -> str:
    """Return the name of a network of these senses."""
    return senses[0] if len(senses) == 1 else FUSION
