"""Compose this package's configuration and run a job with it, wherever Hydra is at the time.

Beside that stand the job that Hydra has begun, and the flags of a command line.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, NoReturn

from hydra import compose, initialize_config_dir
from hydra._internal.callbacks import Callbacks
from hydra._internal.utils import get_args_parser
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.utils import JobRuntime, run_job
from hydra.types import HydraContext, RunMode
from hydra.version import VersionBase
from omegaconf import MISSING, DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from tex_lightning.config import CONF, READ_FILES, Config, flatten, register
from tex_lightning.config.instantiation import TARGET, find_class
from tex_lightning.config.mistakes import unknown_key
from tex_lightning.config.model import (
    CHECKPOINT,
    FUSION,
    PACKAGE_SENSES,
    PhotoConfig,
    SenseConfig,
    SignalConfig,
)
from tex_lightning.config.names import as_typed
from tex_lightning.config.nodes import as_taken, takes
from tex_lightning.config.search import with_own_senses
from tex_lightning.errors import UserError, reason

NAME = "config"
SCHEMAS = {"signal": SignalConfig, "photo": PhotoConfig}  # by the medium of a sense


def compose_config(overrides: Sequence[str] = ()) -> DictConfig:
    """Return the configuration as a command line composes it.

    Args:
        overrides: Such as ``model=haptic``.

    Raises:
        HydraException: If an override is wrong.
    """
    with _hydra():
        return compose(NAME, overrides=with_own_senses(as_typed(overrides)))


def run_composed(function: Callable[[DictConfig], Any], overrides: Sequence[str]) -> Any:  # noqa: ANN401
    """Call a function as Hydra's command line would, in a run folder, and return what it returns.

    Logging and the working directory stay the caller's.

    Raises:
        UserError: If the overrides ask for a sweep.
        Exception: Any exception of the function, or of Hydra for a wrong override.
    """
    raised: list[Exception] = []

    def guarded(composed: DictConfig) -> Any:  # noqa: ANN401
        try:
            return function(composed)
        except Exception as error:  # Hydra would print a line of its own
            raised.append(error)

    with _hydra():
        config = compose(
            NAME, overrides=with_own_senses(as_typed(overrides)), return_hydra_config=True
        )
        if config.hydra.mode == RunMode.MULTIRUN:
            raise UserError(
                "These overrides are a sweep; run it by python -m tex_lightning, or call this "
                "once for each job."
            )
        context = HydraContext(GlobalHydra.instance().config_loader(), Callbacks(config))
        finished = run_job(guarded, config, "hydra.run.dir", None, context, False)
    if raised:
        raise raised[0]
    return finished.return_value


@contextmanager
def _hydra() -> Iterator[None]:
    """Initialise Hydra for this package; afterwards it is as the caller's application left it."""
    register()
    running, base = GlobalHydra.instance().hydra, VersionBase.instance().version_base
    GlobalHydra.instance().clear()
    try:
        with initialize_config_dir(str(CONF), JobRuntime.instance().get("name"), "1.3"):
            yield
    finally:
        GlobalHydra.instance().hydra = running
        VersionBase.instance().version_base = base


Origin = Literal["command", "sweep", "python"]
RUN_FOLDER = "hydra.run.dir="
SEARCHPATH = "hydra.searchpath="


@dataclass(frozen=True)
class Job:
    """One run of one task, in plain values.

    Attributes:
        overrides: Overrides such as ``model=haptic``, without Hydra's keys.
        directory: The run folder, an absolute path.
        origin: Whether a command line runs it, a sweep with others, or a program in Python.
        named: Whether the run folder was given, not made up.
        searchpath: The override that names further folders with configuration files, if any.
        hydra: All of Hydra's own settings, for the record.
    """

    overrides: tuple[str, ...]
    directory: Path
    origin: Origin
    named: bool
    searchpath: tuple[str, ...]
    hydra: DictConfig

    def sets(self, key: str) -> bool:
        """Return whether an override gives a dotted key a value."""
        return any(item.lstrip("+").partition("=")[0] == key for item in self.overrides)

    def compose(self, overrides: Sequence[str]) -> DictConfig:
        """Compose another configuration from the same folders.

        Raises:
            HydraException: If an override is wrong.
        """
        return compose_config([*overrides, *self.searchpath])


def current_job(*, python: bool = False) -> Job:
    """Return the job that Hydra has just begun; nothing below asks Hydra again.

    Args:
        python: Whether a program in Python runs it.
    """
    hydra = HydraConfig.get()
    flags = tuple(hydra.overrides.hydra)
    return Job(
        overrides=tuple(hydra.overrides.task),
        directory=Path(hydra.runtime.output_dir).resolve(),
        origin="python" if python else "sweep" if hydra.mode == RunMode.MULTIRUN else "command",
        named=any(override.startswith(RUN_FOLDER) for override in flags),
        searchpath=tuple(override for override in flags if override.startswith(SEARCHPATH)),
        hydra=OmegaConf.create({"hydra": hydra}),
    )


def read_config(composed: DictConfig) -> Config:
    """Return the typed form of a composed configuration, with custom senses.

    Raises:
        UserError: If a key is open (``???``) or read by nothing, or a sense cannot be used.
    """
    if missing := missing_keys(composed):
        example = " ".join(f"{key}=VALUE" for key in missing)
        raise UserError(f"No value for {', '.join(missing)}; add {example} to the command.")
    config: Config = OmegaConf.to_object(composed)  # type: ignore[assignment]
    model = config.model
    for name, node in vars(model).items():
        if isinstance(node, dict) and TARGET in node and name != "baseline":
            setattr(model, name, _custom_sense(name, node, model.budget))
    for section in map(model.sense, model.known):
        vars(section).update(as_taken(section.node))
    for name in _further_keys(config):
        if "." in name or config.task not in READ_FILES:  # where a key names files of a sense
            raise unknown_key(name, composed)
        config.own[name] = getattr(config, name)
    for name in model.senses:
        if name not in model.known:
            raise UserError(
                f"model.senses names {name}, and there is no such sense: choose from "
                f"{', '.join(model.known)}, or write conf/sense/{name}.yaml and give "
                "--config-dir conf."
            )
    return config


def missing_keys(composed: DictConfig) -> list[str]:
    """Return dotted names of open ``???`` values, without interpolations that refer to them."""
    values: Any = OmegaConf.to_container(composed, resolve=False)
    return sorted(key for key, value in flatten(values).items() if value == MISSING)


def _further_keys(section: Any, prefix: str = "") -> Iterator[str]:  # noqa: ANN401
    """Yield the keys beside those of the schema that neither Lightning nor a user's sense reads."""
    known = {key.name for key in fields(section)}
    for name, value in vars(section).items():
        if is_dataclass(value):
            custom = prefix == "model." and name not in PACKAGE_SENSES and name != FUSION
            yield from (
                () if custom or name == "trainer" else _further_keys(value, f"{prefix}{name}.")
            )
        elif isinstance(section, SenseConfig) and takes(section.node, name, *section.classes):
            continue
        elif name not in known and not (prefix == "model.fusion." and name.endswith(CHECKPOINT)):
            yield f"{prefix}{name}"


def _custom_sense(name: str, node: dict[str, Any], budget: float) -> SenseConfig:
    where = f"model.{name}"
    medium = getattr(find_class(where, node), "medium", None)
    if medium not in SCHEMAS:
        raise UserError(
            f"{where} names {node[TARGET]}, which is no sense: begin its file with defaults: "
            "[signal, _self_] or [photo, _self_]."
        )
    schema = OmegaConf.structured(SCHEMAS[medium])
    for section in (schema, schema.fit.optimizer, schema.fit.schedule):
        OmegaConf.set_struct(section, False)  # further keys are offered to its classes
    try:
        merged = OmegaConf.merge(schema, node)
        merged.fit.steps_per_epoch = max(1, round(budget * merged.fit.steps_per_epoch))
        sense: SenseConfig = OmegaConf.to_object(merged)  # type: ignore[assignment]
    except OmegaConfBaseException as error:
        raise UserError(
            f"{where}: {reason(str(error).splitlines()[0])}; correct conf/sense/{name}.yaml."
        ) from error
    return sense


def split_flags(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the flags of a command line with their values, and its overrides.

    Hydra wants the one before the other.

    Raises:
        UserError: If Hydra does not know a flag, or it lacks its value.
    """

    def refuse(message: str) -> NoReturn:
        raise UserError(
            f"The command line cannot be read ({reason(message)}); give key=value, or a flag that "
            "`python -m tex_lightning --hydra-help` lists."
        )

    parser = get_args_parser()
    parser.error = refuse  # type: ignore[method-assign]
    overrides = parser.parse_intermixed_args(arguments).overrides
    return [item for item in arguments if item not in overrides], overrides
