"""The configuration, typed: a wrong key or type fails while it is composed.

Values live in ``conf/``; here stand types, meanings, choices and ranges. ``???`` (``MISSING``)
marks what a configuration file or the user has to fill in.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import OmegaConf

from tex_lightning.config.data import DataConfig, SyntheticConfig
from tex_lightning.config.keys import SEED, key
from tex_lightning.config.model import (
    FitConfig,
    FusionConfig,
    FusionFitConfig,
    HapticConfig,
    HapticFitConfig,
    ModelConfig,
    ProbeConfig,
    VisualConfig,
    VisualFitConfig,
)
from tex_lightning.config.search import register_folders
from tex_lightning.config.tasks import (
    OPTIMIZED_METRICS,
    READS,
    SILENT,
    CrossvalConfig,
    DecisionConfig,
    EngineConfig,
    FrontierConfig,
    GenerateConfig,
    PredictConfig,
    ProfileConfig,
    StabilityConfig,
    StreamConfig,
    TrainerConfig,
)

__all__ = [
    "READS", "SILENT", "Config", "CrossvalConfig", "DataConfig", "DecisionConfig", "EngineConfig",
    "FitConfig", "FrontierConfig", "FusionConfig", "FusionFitConfig", "GenerateConfig",
    "HapticConfig", "HapticFitConfig", "ModelConfig", "PredictConfig",
    "ProbeConfig", "ProfileConfig", "StabilityConfig", "StreamConfig",
    "SyntheticConfig", "TrainerConfig", "VisualConfig", "VisualFitConfig", "flatten", "register",
]  # fmt: skip

INSIDE = Path(__file__).parents[1] / "conf"  # in an installed wheel
BESIDE = Path(__file__).parents[2] / "conf"  # in a checkout
CONF = INSIDE if INSIDE.is_dir() else BESIDE


@dataclass
class Config:
    """The whole configuration."""

    task: str = key("what to do, set by task=NAME", choices=tuple(READS))
    seed: int = key(
        "of initial weights, order of samples, sub-samples, rotations", least=0, most=SEED
    )
    checkpoint: str | None = key("trained network to classify with or to measure")
    haptic: Any = key(
        "trace(s): a file or a list to predict from; one to profile with; one, or -, to stream",
        default=None,
    )
    image: Any = key(
        "photo(s): a file or a list to predict from; one to profile with", default=None
    )
    top_k: int = key("candidates listed by task=predict", least=1)
    weights: Any = key(
        "of the trunk: file, URL, imagenet or a checkpoint; for several "
        "{TRUNK: FILE, haptic: FILE, ...}; null is random",
        default=None,
    )
    trusted: list[str] = key(
        "packages, beside installed plugins, whose classes a checkpoint may name: their code runs",
        factory=list,
    )
    optimized_metric: str | None = key(
        "what a job returns to a sweeper that searches, to be minimised; vote_error is that of the "
        "tested fold; null takes val_loss where a fold is validated, else vote_error",
        choices=OPTIMIZED_METRICS, default=None,
    )  # fmt: skip
    data: DataConfig = field(default_factory=DataConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    decision: DecisionConfig = field(default_factory=DecisionConfig)
    trainer: TrainerConfig = field(default_factory=TrainerConfig)
    engine: EngineConfig = field(default_factory=EngineConfig)
    callbacks: dict[str, Any] = key("by name, each with its _target_", factory=dict)
    logger: dict[str, Any] = key("by name, each with its _target_", factory=dict)
    crossval: CrossvalConfig = field(default_factory=CrossvalConfig)
    predict: PredictConfig = field(default_factory=PredictConfig)
    stream: StreamConfig = field(default_factory=StreamConfig)
    generate: GenerateConfig = field(default_factory=GenerateConfig)
    profile: ProfileConfig = field(default_factory=ProfileConfig)
    frontier: FrontierConfig = field(default_factory=FrontierConfig)
    stability: StabilityConfig = field(default_factory=StabilityConfig)

    def weights_of(self, kind: str) -> str | None:
        """Where the trunk of HapticNet ("haptic") or of VisualNet starts; None is at random.

        A mapping names both, see :func:`~tex_lightning.config.weights.pick_weights`; anything else
        is meant for the photos' trunk, if the model has one.
        """
        if isinstance(self.weights, dict):
            given: str | None = self.weights.get("haptic" if kind == "haptic" else "visual")
            return given
        return self.weights if (kind == "haptic") == (self.model.kind == "haptic") else None


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
    node = OmegaConf.structured(Config)
    recipes = [node.model[name].fit for name in ("haptic", "visual", "fusion")]
    nodes = [each[part] for each in recipes for part in ("optimizer", "schedule")]
    nodes += [node.data.reader, node.model.visual.trunk, node.callbacks, node.logger]
    for opened in (node.trainer, *nodes):
        OmegaConf.set_struct(opened, False)  # whoever they are passed to knows their keys
    ConfigStore.instance().store(name="tex_lightning_schema", node=node)
