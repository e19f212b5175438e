"""Settings of the decision, of running networks and of tasks."""

from dataclasses import dataclass
from typing import Any

from tex_lightning.config.keys import SEED, key

SIDE = {"range": "[224, 8192]", "unit": "pixels"}  # one patch; what the renderer makes
ROUNDS = "[1, 10000]"
SHARE = "[0, 1]"
CHANCE = "[0, 1)"
TASKS = (
    "fit", "crossval", "evaluate", "enroll", "predict", "stream", "record", "stability",
    "frontier", "profile", "export", "generate", "inspect", "manifest",
)  # fmt: skip
READ_FILES = ("predict", "record", "stream")  # tasks that read files, by modality
TRAINING = ("fit", "crossval")  # tasks that train one model
SILENT = (
    "predict",
    "stream",
    "record",
    "generate",
    "export",
    "manifest",
)  # tasks that leave no results.json
NO_FOLDER = ("predict", "stream", "manifest")  # tasks that write nothing there
OURS = ("threads", "tf32")  # of TrainerConfig, unknown to Lightning
MAX_PAIRS = 1_000_000  # of fragments that FusionNet votes over


@dataclass
class DecisionConfig:
    """How fragments become one label; null takes what the checkpoint says."""

    name: str = key(
        "max_vote: all fragments, sequential: as few as needed", choices=("max_vote", "sequential")
    )
    pairs: int | None = key(
        "number of random pairs or tuples in FusionNet's vote", f"[1, {MAX_PAIRS}]"
    )
    rule: str | None = key(
        "count votes, or average probabilities or scores", choices=("vote", "mean", "score")
    )
    seed: int | None = key("seed of the pairs and of the order of windows", SEED)
    unknown: float | None = key(
        "share of known recordings that may be labelled unknown; 0: none", CHANCE, default=None
    )
    confidence_threshold: float = key(
        "sequential: mean probability at which no more is read", SHARE
    )


@dataclass
class TrainerConfig:
    """Flags of Lightning's Trainer; flags that are not listed here are passed on as well.

    These are attributes too, see :attr:`flags`.
    """

    accelerator: str = key("kind of device", choices=("auto", "cpu", "gpu", "cuda", "mps"))
    devices: Any = key("devices of each machine that train together, or auto", "[1, 64]")
    num_nodes: int = key("machines that srun or torchrun starts together", "[1, 1024]")
    strategy: Any = key("how devices train together: a strategy name of Lightning, or a _target_")
    precision: str = key(
        "numeric precision of training", choices=("32-true", "16-mixed", "bf16-mixed", "64-true")
    )
    tf32: bool = key("on NVIDIA GPUs, round the factors of fp32 products to 10 bits: faster")
    threads: int | None = key(
        "threads of PyTorch on the CPU; null: PyTorch's default", "[1, 1024]", default=None
    )

    @property
    def flags(self) -> dict[str, Any]:
        """Arguments of Lightning's Trainer."""
        return {name: value for name, value in vars(self).items() if name not in OURS}


@dataclass
class EngineConfig:
    """How a trained network is run in testing and prediction; its weights do not change."""

    fast: bool = key("fold batch normalisation, store channels innermost, compute within the cache")
    tile: int | None = key(
        "largest number of pixels, or of frames times 50, in one pass; null: all",
        "[100000, 1000000000000]",  # smaller pieces are nearly all margin
    )


@dataclass
class CrossvalConfig:
    """Cross-validation."""

    only: list[int] | None = key("folds to run, e.g. [0,3]; null runs all", default=None)
    refit: bool = key("then train the same on all recordings, for use: checkpoint=RUN is that one")


@dataclass
class StreamConfig:
    """Classification while a recording goes on."""

    chunk: float = key("signal between two predictions", "(0, 3600]", unit="s")
    window: float | None = key(
        "last part of the signal that is classified; null: all",
        "[0.5, 600]",
        unit="s",
        default=None,
    )
    axes: int = key("axes of the samples on standard input (haptic=-)", "[1, 64]")


@dataclass
class GenerateConfig:
    """Folder and content of written synthetic surfaces."""

    out: str = key("folder to write to, new or empty")
    sound: bool = key("write sounds too")


@dataclass
class ProfileConfig:
    """Inputs and time limits of the profile."""

    classes: int = key("classes of a network without a checkpoint", "[2, 100000]")
    seconds: float = key("length of the rendered trace", "[3, 600]", unit="s")
    width: int = key("width of the rendered photo after halving", **SIDE)
    height: int = key("height of that photo", **SIDE)
    rounds: int = key("largest number of rounds; each times every variant", ROUNDS)
    budget_s: float = key("time after which no fourth round begins", "(0, 86400]", unit="s")


@dataclass
class FrontierConfig:
    """The family of systems that is trained and measured."""

    systems: dict[str, str | None] = key(
        "overrides by name of the system, set by frontier=NAME; null: left out", factory=dict
    )
    senses: list[str] | None = key("senses whose subsets are systems of model=NAME", default=None)
    only: list[str] | None = key("some of the systems by name; null runs all", default=None)


@dataclass
class StabilityConfig:
    """Systems and perturbations that are tested, and how thoroughly."""

    systems: list[str] | None = key("run folders or checkpoints", default=None)
    only: list[str] | None = key("perturbations by name; null: all", default=None)
    severities: list[str] = key("files of further perturbations, as severities.yaml", factory=list)


@dataclass
class ExportConfig:
    """Format and checks of exported files."""

    out: str | None = key("folder to write to; null takes the run folder", default=None)
    format: str = key(
        "onnx: ONNX Runtime, web: page for browsers, card: model card",
        choices=("onnx", "web", "card"),
    )
    check: int = key("recordings of noise on which the file is compared", "[0, 100000]")
    web_runtime: str | None = key(".tgz of onnxruntime-web; null fetches it", default=None)
