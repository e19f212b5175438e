"""The typed configuration: a wrong key or type fails while it is composed.

``conf/`` has the values. Types, ranges, choices and meanings are annotations: of the sections, in
:mod:`.data`, :mod:`.model`, :mod:`.tasks` and here, and of the classes that a ``_target_`` names,
whose keys stand nowhere else. ``???`` (``MISSING``) marks what a file or the user has to fill in.

A command line passes :mod:`.user_folders` and :mod:`.quoting`, is composed by :mod:`.composition`,
and typed and checked by :mod:`.check` with the :mod:`.rules`; :mod:`.mistakes` says what is wrong
with it. Annotations are read by :mod:`.keys`, values are held against them by :mod:`.signatures`,
those of classes that are not imported yet by :mod:`.static_signatures` and :mod:`.nodes`, and
objects are built by :mod:`.instantiation`. :mod:`.overrides` reads back what a run was given, and
:mod:`.help_text` is ``--help``.
"""

from dataclasses import dataclass, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from hydra.core.config_store import ConfigStore
from hydra.core.plugins import Plugins
from omegaconf import DictConfig, OmegaConf

from tex_lightning.config import tasks
from tex_lightning.config.data import DataConfig, Folding, RecordConfig
from tex_lightning.config.instantiation import find_class
from tex_lightning.config.keys import SEED, TEXT, section
from tex_lightning.config.model import FUSION, PACKAGE_SENSES, ModelConfig
from tex_lightning.config.tasks import (
    READ_FILES,
    SILENT,
    TASKS,
    TRAINING,
    DecisionConfig,
    EngineConfig,
    ProfileConfig,
    StabilityConfig,
    StreamConfig,
    Task,
    TrainerConfig,
)
from tex_lightning.config.user_folders import CONF, UserFolders, variants
from tex_lightning.core.run_folder import system_name

__all__ = [
    "CONF", "READ_FILES", "SILENT", "TASKS", "Config", "DataConfig", "DecisionConfig",
    "EngineConfig", "Folding", "Job", "ModelConfig", "ProfileConfig", "StabilityConfig",
    "StreamConfig", "TrainerConfig", "flatten", "plain_values", "register", "trunk_name",
]  # fmt: skip

SCHEMA = "tex_lightning_schema"  # the first of the defaults in conf/config.yaml
LISTED = 3  # systems in the name of a run folder


@section
class Config:
    """The whole configuration."""

    task: Annotated[str, Task, "what to do, set by task=NAME"]
    verbose: Annotated[
        int,
        "[0, 2]",
        "0: the result and errors; 1: progress and messages too; 2: those of libraries too",
    ]
    seed: Annotated[int, SEED, "seed of initial weights, order of samples, sub-samples, rotations"]
    checkpoint: Annotated[str | None, "trained network to classify with or to measure"]
    haptic: Annotated[
        Any, TEXT, "trace(s); - to stream; to record: -, serial:PORT, soundcard, a file"
    ] = None
    image: Annotated[Any, TEXT, "photo(s) to predict from; to record: camera:NUMBER or a video"] = (
        None
    )
    sound: Annotated[Any, TEXT, "sound(s): as haptic"] = None
    own: Annotated[dict[str, Any], TEXT, "files of custom modalities; +NAME=FILE adds one"]
    pattern: Annotated[
        str | None, "task=manifest: path below data.root, such as {label}/{person}_{group}.wav"
    ] = None
    top_k: Annotated[int, "[1, inf)", "candidates listed by task=predict"]
    adapt: Annotated[bool, "task=predict: adapt to all files first, as task=adapt does"]
    weights: Annotated[
        Any, TEXT, "first weights of trunks: FILE, imagenet or {TRUNK: FILE}; null: random"
    ] = None
    trusted: Annotated[list[str], "packages whose classes a checkpoint may name: their code runs"]
    data: DataConfig
    model: ModelConfig
    decision: DecisionConfig
    trainer: TrainerConfig
    engine: EngineConfig
    callbacks: Annotated[dict[str, Any], "callbacks by name, each with its _target_"]
    logger: Annotated[dict[str, Any], "loggers by name, each with its _target_"]
    crossval: tasks.CrossvalConfig
    stream: StreamConfig
    record: RecordConfig
    export: tasks.ExportConfig
    generate: tasks.GenerateConfig
    profile: ProfileConfig
    frontier: tasks.FrontierConfig
    stability: StabilityConfig

    @property
    def files(self) -> dict[str, Any]:
        """Files to predict from, by modality."""
        files = {"haptic": self.haptic, "image": self.image, "sound": self.sound, **self.own}
        return {modality: value for modality, value in files.items() if value is not None}

    def on_fold(self, fold: int | None) -> "Config":
        """Copy it with another test fold, or with none."""
        return replace(self, data=replace(self.data, test_fold=fold))

    @property
    def sources(self) -> dict[str, str]:
        """Sources of the first weights of trunks, by sense; one that has none is random.

        ``{TRUNK: SOURCE, haptic: SOURCE}`` names several, such as those of a sweep; a single source
        is meant for the photos' trunk, or for that of the only sense.
        """
        senses = self.model.senses
        if isinstance(self.weights, dict):
            sources = {name: self.weights.get(trunk_name(self.model, name)) for name in senses}
        else:
            single = [name for name in senses if name == "visual" or len(senses) == 1]
            sources = dict.fromkeys(single, self.weights)
        return {name: source for name, source in sources.items() if source is not None}


Origin = Literal["command", "sweep", "python"]


@dataclass(frozen=True)
class Job:
    """One run of one task: what was given, and what Hydra made of it.

    Attributes:
        overrides: Overrides such as ``model=haptic``, without Hydra's keys.
        directory: The run folder, an absolute path.
        origin: Whether a command line runs it, a sweep with others, or a program in Python.
        named: Whether the run folder was given, not made up.
        searchpath: The override that names further folders with configuration files, if any.
        composed: The configuration.
        hydra: All of Hydra's own settings, for the record.
    """

    overrides: tuple[str, ...]
    directory: Path
    origin: Origin
    named: bool
    searchpath: tuple[str, ...]
    composed: DictConfig
    hydra: DictConfig

    @property
    def folder_key(self) -> str:
        """Key that names the run folder, or the folder of its sweep."""
        return f"hydra.{'sweep' if self.origin == 'sweep' else 'run'}.dir"

    @property
    def record(self) -> dict[str, Any]:
        """Content of each file of ``.hydra`` in the run folder, by name."""
        overrides = OmegaConf.create([*self.overrides])
        return {"config": self.composed, "hydra": self.hydra, "overrides": overrides}

    def sets(self, key: str) -> bool:
        """Return whether an override gives a dotted key a value."""
        return any(item.lstrip("+").partition("=")[0] == key for item in self.overrides)

    def adding(self, *overrides: str) -> "Job":
        """Return the job with further overrides."""
        return replace(self, overrides=(*self.overrides, *overrides))


def trunk_name(model: ModelConfig, sense: str) -> str:
    """Return the sense; of photos the published name of the trunk, or that of its class."""
    if sense != "visual":
        return sense
    if model.baseline is not None:
        return str(model.baseline.get("trunk"))
    from tex_lightning.networks.trunks import name_trunk  # takes PyTorch

    return name_trunk(find_class("model.visual.trunk", model.visual.node["trunk"]))


def plain_values(node: Any) -> Any:  # noqa: ANN401
    """Return a part of the configuration as plain values, a user's keys included."""
    if is_dataclass(node):
        node = vars(node)
    if isinstance(node, dict):
        return {name: plain_values(value) for name, value in node.items()}
    return [plain_values(item) for item in node] if isinstance(node, list) else node


def flatten(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested plain values as one dictionary with dotted keys."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            flat.update(flatten(value, f"{prefix}{name}."))
        else:
            flat[f"{prefix}{name}"] = value
    return flat


def register() -> None:
    """Make the schema known to Hydra, beside those of other applications in this process."""
    Plugins.instance().register(UserFolders)  # a second call changes nothing
    OmegaConf.register_new_resolver("subject", subject, replace=True)
    store = ConfigStore.instance()
    if f"{SCHEMA}.yaml" in store.repo:
        return
    store.store(name=SCHEMA, node=_schema())
    for name, node in variants().items():
        group, _, option = name.rpartition("/")
        package = "_global_" if name.startswith("experiment/") else None  # it sets keys of any
        store.store(group=group, name=option, node=node, package=package)


def subject(*, _root_: DictConfig) -> str:
    """Return what a run works on, for its folder.

    That are the systems of a stability test, a family of systems, whose checkpoint is taken, or
    the configured model. OmegaConf gives the whole configuration.
    """
    task, source = _root_.task, OmegaConf.select(_root_, "checkpoint")
    if task == "stability" and (systems := OmegaConf.select(_root_, "stability.systems")):
        names = [] if isinstance(systems, str) else [system_name(str(system)) for system in systems]
        return "+".join(names) if 0 < len(names) <= LISTED else f"{len(names)}_systems"
    if task == "frontier":
        return str(OmegaConf.select(_root_, "hydra.runtime.choices.frontier"))
    return str(_root_.model.name) if source is None or task in TRAINING else system_name(source)


@cache  # Hydra copies it; made anew it would be a sixth of every composition
def _schema() -> DictConfig:
    """Return the dataclasses as Hydra composes them: closed, but for keys of others."""
    node: DictConfig = OmegaConf.structured(Config)
    model = node.model
    fits = [model[name].fit for name in (*PACKAGE_SENSES, FUSION)]
    parts = [fit[part] for fit in fits for part in ("optimizer", "schedule")]
    parts += [model[name] for name in PACKAGE_SENSES]
    parts += [node.data.reader, node.callbacks, node.logger]
    # whoever they are passed to knows their keys; senses may be a user's
    for opened in (model, model.fusion, node.trainer, node.record.conditions, *parts):
        OmegaConf.set_struct(opened, False)
    return node
