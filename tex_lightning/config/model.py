"""The section ``model`` of the configuration: senses, networks, fusion and recipes."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Annotated, Any, ClassVar, Literal

from tex_lightning.config.keys import section

FUSION = "fusion"  # name of several senses together
PACKAGE_SENSES = ("haptic", "visual", "sound")  # senses of the package; others are a user's
CHECKPOINT = "_checkpoint"  # end of a key of the fusion
ROTATION = "[0, 180] degrees"
PERTURB = "perturbations to train on too, named in tex_lightning/perturbations/severities.yaml"


@section
class FitConfig:
    """One network's training recipe.

    Training takes ``epochs * steps_per_epoch`` optimiser steps; an epoch is only the time between
    two checkpoints.
    """

    epochs: Annotated[int, "[0, 1000000]", "number of epochs; each ends with a checkpoint"]
    steps_per_epoch: Annotated[int, "[1, 1000000]", "optimiser steps in an epoch"]
    batch_size: Annotated[int, "[1, 4096]", "samples in a step, over all processes"]
    optimizer: Annotated[dict[str, Any], "class and arguments of the optimiser"]
    learning_rate: Annotated[float, "(0, 10]", "largest learning rate of the trunk"]
    schedule: Annotated[
        dict[str, Any], "class and arguments of the schedule, applied after every step"
    ]
    label_smoothing: Annotated[
        float, "[0, 1)", "share of the target that is spread over all classes"
    ]
    head_factor: Annotated[
        float, "(0, 1000]", "learning rate of the 1x1 layers over that of the trunk"
    ]

    piece_key: ClassVar[str] = ""

    @property
    def piece(self) -> int:
        """How much of a recording is trained on at once."""
        size: int = getattr(self, self.piece_key)
        return size


@section
class SignalFitConfig(FitConfig):
    """Training on sub-samples of spectrograms; FusionNet is perturbed alike."""

    frames: Annotated[
        int,
        "[1, 20000]",
        "frames of a sub-sample; longer signals are cut at random, shorter repeated",
    ]
    sensor_augmentation: Annotated[
        float,
        "[0, 1]",
        "share of sub-samples with added noise, and share with another frequency response; only of "
        "spectrograms with normalisation=standard",
    ]
    score_shrinkage: Annotated[
        float | None,
        "[0, 1000000]",
        "how far FC3's discriminants take the scatter within classes for equal in all directions; "
        "null: FC3 as trained",
    ]
    perturb: Annotated[list[str], PERTURB]
    perturbed_copies: Annotated[int, "[1, 100]", "perturbed versions of every signal"]

    piece_key: ClassVar[str] = "frames"


@section
class ProbeConfig:
    """Fit of VisualNet's FC3 to the features of whole photos, where ``head`` is empty."""

    passes: Annotated[int, "[1, 1000]", "passes over the training photos, each with new crops"]
    strength: Annotated[float, "(0, 1000000]", "inverse of the regularisation"]
    side: Annotated[int, "[224, 8192] pixels", "largest side; larger photos are cut"]


@section
class PhotoFitConfig(FitConfig):
    """Training on square patches; FusionNet is perturbed alike."""

    patch: Annotated[int, "[1, 2048] pixels", "side of a training patch"]
    rotation: Annotated[float, ROTATION, "largest random rotation either way"]
    augmentation: Annotated[
        Any, "class that changes training patches (batch, 3, side, side) in [0, 1]"
    ] = None
    perturb: Annotated[list[str], PERTURB]
    perturbed_share: Annotated[float, "[0, 1]", "share of patches that are perturbed"]
    probe: ProbeConfig

    piece_key: ClassVar[str] = "patch"


@section
class FusionFitConfig(FitConfig):
    """Training of FusionNet, on inputs as large as the receptive fields."""

    head_factor: Annotated[
        float,
        "[10, 50]",
        "learning rate of the fusion layer over that of the networks, as the paper",
    ]
    rotation: Annotated[float, ROTATION, "largest random rotation of photos"]


@section
class SenseConfig:
    """One sense; a user's own has ``fit`` of the kind of its recordings.

    The keys beside ``fit`` form a node, which a card keeps and from which a sense is built. Its
    classes receive the keys that they have parameters for.

    Attributes:
        classes: Whose keys it may have too, whether they are named in it or not: a recipe that
            names others leaves the keys of the package's in their place.
        decoder: Class whose keys ``decode`` has.
    """

    classes: ClassVar[tuple[str, ...]] = ()
    decoder: ClassVar[str] = ""

    _target_: Annotated[str, "class of the sense: of signals or of photos"]
    modality: Annotated[str, "modality of its recordings, and of files to predict from"]
    decode: Annotated[dict[str, Any], "how files are decoded"]
    features: Annotated[
        dict[str, Any], "class from decoded recording to network input, and its keys"
    ]
    network: Annotated[dict[str, Any], "class of the network, and its keys"]
    fit: Any = None

    @property
    def node(self) -> dict[str, Any]:
        """Plain values from which the sense is built, including a user's own keys."""
        return {name: value for name, value in vars(self).items() if name != "fit"}


@section
class SignalConfig(SenseConfig):
    """A sense of signals; beside its fields it has the keys of its classes."""

    classes: ClassVar = (
        "tex_lightning.senses.features.spectrogram.SpectrogramFeatures",
        "tex_lightning.networks.hapticnet.HapticNet",
    )
    decoder: ClassVar = "tex_lightning.data.decode.SignalDecoder"
    fit: SignalFitConfig


@section
class PhotoConfig(SenseConfig):
    """A sense of photos; beside its fields it has the keys of its classes."""

    classes: ClassVar = (
        "tex_lightning.networks.visualnet.VisualNet",
        "tex_lightning.networks.trunks.base.Trunk",
    )
    decoder: ClassVar = "tex_lightning.data.decode.PhotoDecoder"
    fit: PhotoFitConfig


@section
class FusionConfig:
    """FusionNet: which layer is fused and where the unimodal networks come from.

    A user's sense has its ``NAME_checkpoint`` too.
    """

    level: Annotated[str, Literal["fc2", "fc3"], "layer that is fused"]
    haptic_checkpoint: Annotated[str | None, "HapticNet to start from; null trains one"] = None
    visual_checkpoint: Annotated[str | None, "VisualNet to start from; null trains one"] = None
    sound_checkpoint: Annotated[str | None, "sound network; null trains one"] = None
    head_start: Annotated[
        str,
        Literal["scores", "random"],
        "first weights of the fusion layer: the sum of all scores, or random",
    ]
    fit: FusionFitConfig


@section
class ModelConfig:
    """The model that is trained; a user's own senses are attributes too."""

    name: Annotated[str, "model, set by model=NAME"]
    senses: Annotated[
        list[str], "haptic, visual, sound or a custom sense; several are trained, then fused"
    ]
    baseline: Annotated[Any, "class of the baseline in place of a network, and its keys"] = None
    budget: Annotated[float, "(0, 1000]", "factor on the steps of a baseline or of a custom sense"]
    haptic: SignalConfig
    visual: PhotoConfig
    sound: SignalConfig
    fusion: FusionConfig

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
        """The nodes of its baseline and of all senses: what may be built without a checkpoint."""
        return [self.baseline, *(self.sense(name).node for name in self.known)]

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
