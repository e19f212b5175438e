"""The sections of the configuration for the decision, the engine and the tasks."""

from typing import Annotated, Any, Literal, get_args

from tex_lightning.config.keys import SEED, section

SIDE = "[224, 8192] pixels"  # one patch; what the renderer makes
Task = Literal[
    "fit", "crossval", "evaluate", "enroll", "adapt", "predict", "stream", "record",
    "stability", "frontier", "profile", "export", "generate", "inspect", "manifest",
]  # fmt: skip
TASKS: tuple[str, ...] = get_args(Task)
READ_FILES = ("adapt", "predict", "record", "stream")  # tasks that read files, by modality
TRAINING = ("fit", "crossval")  # tasks that train one model
# Tasks that leave no results.json.
SILENT = ("predict", "stream", "record", "generate", "export", "manifest")
NO_FOLDER = ("predict", "stream", "manifest")  # tasks that write nothing there
OURS = ("threads", "tf32")  # of TrainerConfig, unknown to Lightning


@section
class DecisionConfig:
    """The decision on a sample; null takes the setting of the checkpoint."""

    name: Annotated[
        str,
        Literal["max_vote", "sequential"],
        "max_vote: all fragments, sequential: as few as needed",
    ]
    pairs: Annotated[
        int | None, "[1, 1000000]", "number of random pairs or tuples in FusionNet's vote"
    ]
    rule: Annotated[
        str | None,
        Literal["vote", "mean", "score"],
        "count votes, or average probabilities or scores",
    ]
    seed: Annotated[int | None, SEED, "seed of the pairs and of the order of windows"]
    unknown: Annotated[
        float | None, "[0, 1)", "share of known recordings that may be labelled unknown; 0: none"
    ] = None
    confidence_threshold: Annotated[
        float, "[0, 1]", "sequential: mean probability at which no more is read"
    ]


@section
class TrainerConfig:
    """Flags of Lightning's Trainer; flags that are not listed here are passed on as well.

    These are attributes too, see :attr:`flags`.
    """

    accelerator: Annotated[str, Literal["auto", "cpu", "gpu", "cuda", "mps"], "kind of device"]
    devices: Annotated[Any, "[1, 64]", "devices of each machine that train together, or auto"]
    num_nodes: Annotated[int, "[1, 1024]", "machines that srun or torchrun starts together"]
    strategy: Annotated[
        Any, "how devices train together: a strategy name of Lightning, or a _target_"
    ]
    precision: Annotated[
        str,
        Literal["32-true", "16-mixed", "bf16-mixed", "64-true"],
        "numeric precision of training",
    ]
    tf32: Annotated[bool, "on NVIDIA GPUs, round the factors of fp32 products to 10 bits: faster"]
    threads: Annotated[
        int | None, "[1, 1024]", "threads of PyTorch on the CPU; null: PyTorch's default"
    ] = None

    @property
    def flags(self) -> dict[str, Any]:
        """Arguments of Lightning's Trainer."""
        return {name: value for name, value in vars(self).items() if name not in OURS}


@section
class EngineConfig:
    """The accelerated copy of a network for tests and predictions."""

    fast: Annotated[
        bool, "fold batch normalisation, store channels innermost, compute within the cache"
    ]
    tile: Annotated[
        int | None,
        "[100000, 1000000000000]",
        "largest number of pixels, or of frames times 50, in one pass; null: all",
    ]


@section
class CrossvalConfig:
    """Cross-validation."""

    only: Annotated[list[int] | None, "folds to run, e.g. [0,3]; null runs all"] = None
    refit: Annotated[
        bool, "then train the same on all recordings, for use: checkpoint=RUN is that one"
    ]


@section
class StreamConfig:
    """Classification while a recording goes on."""

    chunk: Annotated[float, "(0, 3600] s", "signal between two predictions"]
    window: Annotated[
        float | None, "[0.5, 600] s", "last part of the signal that is classified; null: all"
    ] = None
    axes: Annotated[int, "[1, 64]", "axes of the samples on standard input (haptic=-)"]


@section
class GenerateConfig:
    """Folder and content of written synthetic surfaces."""

    out: Annotated[str, "folder to write to, new or empty"]
    sound: Annotated[bool, "write sounds too"]


@section
class ProfileConfig:
    """Inputs and time limits of the profile."""

    classes: Annotated[int, "[2, 100000]", "classes of a network without a checkpoint"]
    seconds: Annotated[float, "[3, 600] s", "length of the rendered trace"]
    width: Annotated[int, SIDE, "width of the rendered photo after halving"]
    height: Annotated[int, SIDE, "height of that photo"]
    rounds: Annotated[int, "[1, 10000]", "largest number of rounds; each times every variant"]
    budget_s: Annotated[float, "(0, 86400] s", "time after which no fourth round begins"]


@section
class FrontierConfig:
    """The family of systems that is trained and measured."""

    systems: Annotated[
        dict[str, str | None],
        "overrides by name of the system, set by frontier=NAME; null: left out",
    ]
    senses: Annotated[list[str] | None, "senses whose subsets are systems of model=NAME"] = None
    only: Annotated[list[str] | None, "some of the systems by name; null runs all"] = None


@section
class StabilityConfig:
    """Systems and perturbations that are tested, and how thoroughly."""

    systems: Annotated[list[str] | None, "run folders or checkpoints"] = None
    only: Annotated[list[str] | None, "perturbations by name; null: all"] = None
    severities: Annotated[list[str], "files of further perturbations, as severities.yaml"]


@section
class ExportConfig:
    """Format and checks of exported files."""

    out: Annotated[str | None, "folder to write to; null takes the run folder"] = None
    format: Annotated[
        str,
        Literal["onnx", "web", "card"],
        "onnx: ONNX Runtime, web: page for browsers, card: model card",
    ]
    check: Annotated[int, "[0, 100000]", "recordings of noise on which the file is compared"]
    web_runtime: Annotated[str | None, ".tgz of onnxruntime-web; null fetches it"] = None
