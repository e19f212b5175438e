"""The typed configuration: a wrong key or type fails while it is composed.

``conf/`` has the values, this package types, meanings, choices and ranges. ``???`` (``MISSING``)
marks what a configuration file or the user has to fill in.
"""

from dataclasses import dataclass, field, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import DictConfig, OmegaConf

from tex_lightning.config.data import (
    DataConfig,
    Folding,
    RecordConfig,
    SourceConfig,
    SyntheticConfig,
)
from tex_lightning.config.keys import SEED, key
from tex_lightning.config.model import FUSION, PACKAGE_SENSES, ModelConfig
from tex_lightning.config.search import register_folders
from tex_lightning.config.tasks import (
    OPTIMIZED_METRICS,
    READ_FILES,
    READS,
    SILENT,
    CrossvalConfig,
    DecisionConfig,
    EngineConfig,
    EnrollConfig,
    ExportConfig,
    FrontierConfig,
    GenerateConfig,
    PredictConfig,
    ProfileConfig,
    StabilityConfig,
    StreamConfig,
    TrainerConfig,
)

__all__ = [
    "READS", "READ_FILES", "SILENT", "Config", "CrossvalConfig", "DataConfig", "DecisionConfig",
    "EngineConfig", "EnrollConfig", "ExportConfig", "Folding", "FrontierConfig",
    "GenerateConfig",
    "ModelConfig", "PredictConfig", "ProfileConfig", "RecordConfig", "SourceConfig",
    "StabilityConfig", "StreamConfig", "SyntheticConfig", "TrainerConfig", "flatten",
    "plain_values", "register",
]  # fmt: skip

INSIDE = Path(__file__).parents[1] / "conf"  # in an installed wheel
BESIDE = Path(__file__).parents[2] / "conf"  # in a checkout
CONF = INSIDE if INSIDE.is_dir() else BESIDE


@dataclass
class Config:
    """The whole configuration."""

    task: str = key("what to do, set by task=NAME", choices=tuple(READS))
    verbose: int = key(
        "what standard error shows: 0 the result and errors, 1 also progress and messages, 2 also "
        "Lightning's summary, other libraries' messages, metrics of each epoch and timings",
        least=0, most=2,
    )  # fmt: skip
    seed: int = key(
        "seed of initial weights, order of samples, sub-samples, rotations", least=0, most=SEED
    )
    checkpoint: str | None = key("trained network to classify with or to measure")
    haptic: Any = key(
        "trace(s): a file or a list to predict from; one to profile with; one, or -, to stream; a "
        "source to record: -, tcp://HOST:PORT, serial:PORT, soundcard, soundcard:NAME, a file",
        default=None,
    )
    image: Any = key(
        "photo(s): a file or a list to predict from; one to profile with; camera:NUMBER, or a file "
        "that OpenCV reads, to record",
        default=None,
    )
    sound: Any = key(
        "sound(s): a file or a list to predict from; a source to record, as for haptic",
        default=None,
    )
    own: dict[str, Any] = key(
        "files of your own senses to predict from, stream or profile with, by modality; "
        "+NAME=FILE adds one",
        factory=dict,
    )
    top_k: int = key("candidates listed by task=predict", least=1)
    weights: Any = key(
        "initial weights of the trunk: file, URL, imagenet or a checkpoint; for several trunks "
        "{TRUNK: FILE, haptic: FILE, ...}; null is random",
        default=None,
    )
    trusted: list[str] = key(
        "packages, beside installed plugins, whose classes a checkpoint may name: their code runs",
        factory=list,
    )
    optimized_metric: str | None = key(
        "value that a job returns to a searching sweeper, to minimise; vote_error is that of the "
        "tested fold; null takes val_loss if there is a validation fold, else vote_error",
        choices=OPTIMIZED_METRICS, default=None,
    )  # fmt: skip
    explained_samples: int = key(
        "number of test samples whose votes are drawn (docs/predict.md): wrong ones, the surest "
        "first, or if there are none the least sure; 0 draws none",
        least=0, most=100,
    )  # fmt: skip
    data: DataConfig = field(default_factory=DataConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    decision: DecisionConfig = field(default_factory=DecisionConfig)
    trainer: TrainerConfig = field(default_factory=TrainerConfig)
    engine: EngineConfig = field(default_factory=EngineConfig)
    callbacks: dict[str, Any] = key("callbacks by name, each with its _target_", factory=dict)
    logger: dict[str, Any] = key("loggers by name, each with its _target_", factory=dict)
    crossval: CrossvalConfig = field(default_factory=CrossvalConfig)
    enroll: EnrollConfig = field(default_factory=EnrollConfig)
    predict: PredictConfig = field(default_factory=PredictConfig)
    stream: StreamConfig = field(default_factory=StreamConfig)
    record: RecordConfig = field(default_factory=RecordConfig)
    export: ExportConfig = field(default_factory=ExportConfig)
    generate: GenerateConfig = field(default_factory=GenerateConfig)
    profile: ProfileConfig = field(default_factory=ProfileConfig)
    frontier: FrontierConfig = field(default_factory=FrontierConfig)
    stability: StabilityConfig = field(default_factory=StabilityConfig)

    @property
    def files(self) -> dict[str, Any]:
        """Files to predict from, by modality."""
        given = {"haptic": self.haptic, "image": self.image, "sound": self.sound, **self.own}
        return {modality: value for modality, value in given.items() if value is not None}

    def weights_of(self, sense: str) -> str | None:
        """Source of the first weights of one sense's trunk; None is random.

        A mapping names several, see :func:`~tex_lightning.config.weights.pick_weights`; anything
        else is meant for the photos' trunk, or for that of the only sense.
        """
        if isinstance(self.weights, dict):
            given: str | None = self.weights.get(sense)
            return given
        alone = self.model.senses == [sense]
        return self.weights if alone or sense == "visual" else None

    def start_of(self, kind: str) -> str | None:
        """Source of a network's first weights; FusionNet's senses are trained already."""
        return None if kind == FUSION else self.weights_of(kind)

    @property
    def baseline_weights(self) -> str | None:
        """Source of the weights of a baseline's trunk."""
        return next(filter(None, map(self.weights_of, self.model.senses)), None)


def plain_values(node: Any) -> Any:  # noqa: ANN401
    """A part of the configuration as plain values, Lightning's flags and a user's keys included."""
    if is_dataclass(node):
        node = vars(node)
    if isinstance(node, dict):
        return {name: plain_values(value) for name, value in node.items()}
    return [plain_values(item) for item in node] if isinstance(node, list) else node


def flatten(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested plain values as one dictionary with dotted keys."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            flat.update(flatten(value, f"{prefix}{name}."))
        else:
            flat[f"{prefix}{name}"] = value
    return flat


def register() -> None:
    """Make the schema known to Hydra, beside those of other applications in this process."""
    register_folders()
    ConfigStore.instance().store(name="tex_lightning_schema", node=_schema())


@cache  # Hydra copies it; made anew it would be a sixth of every composition
def _schema() -> DictConfig:
    """The dataclasses as Hydra composes them: closed, except sections with keys of others."""
    node: DictConfig = OmegaConf.structured(Config)
    sections = [node.model[name] for name in (*PACKAGE_SENSES, FUSION)]
    nodes = [each.fit[part] for each in sections for part in ("optimizer", "schedule")]
    nodes += [node.model[name][part] for name in PACKAGE_SENSES for part in ("features", "network")]
    nodes += [node.data.reader, node.model.visual.trunk, node.callbacks, node.logger]
    nodes += [node.record.conditions]
    # whoever they are passed to knows their keys; senses may be a user's
    for opened in (node.model, node.model.fusion, node.trainer, *nodes):
        OmegaConf.set_struct(opened, False)
    return node
