"""Compose this package's configuration and run a job with it, wherever Hydra is at the time.

Beside that stand the job that Hydra has begun, and the flags of a command line.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NoReturn

from hydra import compose, initialize_config_dir
from hydra._internal.callbacks import Callbacks
from hydra._internal.utils import get_args_parser
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.utils import JobRuntime, JobStatus, run_job
from hydra.errors import OverrideParseException
from hydra.types import HydraContext, RunMode
from hydra.version import VersionBase
from omegaconf import DictConfig, OmegaConf

from tex_lightning.config import CONF, Job, register
from tex_lightning.config.overrides import parsed_overrides
from tex_lightning.config.quoting import as_typed
from tex_lightning.config.user_folders import check_text, config_groups, is_added, with_own_senses
from tex_lightning.errors import UserError, reason, shorten

NAME = "config"


def compose_config(overrides: Sequence[str] = ()) -> DictConfig:
    """Return the configuration as a command line composes it.

    Raises:
        HydraException: If an override is wrong.
    """
    with _hydra():
        return compose(NAME, overrides=as_composed(overrides))


def as_composed(overrides: Sequence[str]) -> list[str]:
    """Return overrides as Hydra gets them: names in quotes, and the senses of a user's folders.

    Raises:
        UserError: If a run folder has no name, for which Hydra would take the current folder,
            ``hydra.searchpath`` names a folder that is not there, or a group is to be what its
            options begin with.
    """
    check_text(overrides)
    for override in overrides:
        key, _, value = override.partition("=")
        if key in ("hydra.run.dir", "hydra.sweep.dir") and not value.strip(" '\""):
            raise UserError(f"{key} is empty; give a folder, or leave it out.")
        _check_is_option(key.lstrip("+"), value)
    typed = as_typed(overrides)
    for override in typed:
        _check_is_name(override)
    return with_own_senses(typed)


def _check_is_option(group: str, option: str) -> None:
    """Reject a file of the package that options of a group begin with, and that is none itself."""
    if option.rpartition("/")[2] == "base" and (CONF / group / f"{option}.yaml").is_file():
        options = ", ".join(sorted(config_groups().get(group, ())))
        instead = f"choose one of {options}" if options else "leave it out"
        raise UserError(f"{group}={option} is what options begin with, and none itself; {instead}.")


def _check_is_name(override: str) -> None:
    """Reject a number or truth value in the place of an option of a group of the package.

    A mapping is none: it gives values to the keys of the section.
    """
    group = override.partition("=")[0].partition("@")[0].lstrip("+")
    if not group or not (CONF / group).is_dir():
        return
    with suppress(OverrideParseException):  # which Hydra will raise
        (parsed,) = parsed_overrides([override])
        value = {} if parsed.is_sweep_override() else parsed.value()
        names = value if isinstance(value, list) else [value]
        if not isinstance(value, dict) and not all(isinstance(name, str) for name in names):
            options = ", ".join(sorted(config_groups().get(group, ())))
            raise UserError(
                f"{shorten(override)} cannot be used: an option is a name; choose one of "
                f"{options}, or leave it out by ~{group}."
            )


def run_composed(function: Callable[[DictConfig], Any], overrides: Sequence[str]) -> Any:  # noqa: ANN401
    """Call a function as Hydra's command line would, in a run folder, and return what it returns.

    Logging and the working directory stay the caller's.

    Raises:
        UserError: If the overrides ask for a sweep.
        Exception: Any exception of the function, or of Hydra for a wrong override.
    """
    with _hydra():
        config = compose(NAME, overrides=as_composed(overrides), return_hydra_config=True)
        if config.hydra.mode == RunMode.MULTIRUN:
            raise UserError(
                "These overrides are a sweep; run it by python -m tex_lightning, or call this "
                "once for each job."
            )
        context = HydraContext(GlobalHydra.instance().config_loader(), Callbacks(config))
        finished = run_job(function, config, "hydra.run.dir", None, context, False)
    if finished.status == JobStatus.FAILED:
        raise finished._return_value  # else Hydra prints a line of its own
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


def compose_for(job: Job, overrides: Sequence[str]) -> DictConfig:
    """Compose another configuration from the folders of a job.

    Raises:
        HydraException: If an override is wrong.
    """
    return compose_config([*overrides, *job.searchpath])


def current_job(composed: DictConfig, *, python: bool = False) -> Job:
    """Return the job that Hydra has just begun, for a command line or for a program in Python.

    Nothing below asks Hydra again.
    """
    hydra = HydraConfig.get()
    # as they were typed: an interpolation has its meaning at its key, and none in a list of texts
    typed: Any = OmegaConf.to_container(hydra.overrides, resolve=False)
    flags = tuple(typed["hydra"])
    return Job(
        overrides=tuple(each for each in typed["task"] if not is_added(each)),
        directory=Path(hydra.runtime.output_dir).resolve(),
        origin="python" if python else "sweep" if hydra.mode == RunMode.MULTIRUN else "command",
        named=any(each.startswith("hydra.run.dir=") for each in flags),
        searchpath=tuple(each for each in flags if each.startswith("hydra.searchpath=")),
        composed=composed,
        hydra=OmegaConf.create({"hydra": hydra}),
    )


def split_flags(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the flags of a command line with their values, and its overrides.

    Hydra wants the one before the other.

    Raises:
        UserError: If Hydra does not know a flag, it lacks its value, or it would take the place of
            the package's configuration.
    """

    def refuse(message: str) -> NoReturn:
        raise UserError(
            f"The command line cannot be read ({reason(message)}); give key=value, or a flag that "
            "`python -m tex_lightning --hydra-help` lists."
        )

    parser = get_args_parser()
    parser.error = refuse  # type: ignore[method-assign]
    given = parser.parse_intermixed_args(arguments)
    if given.config_path or (given.config_dir and given.config_name in ("config", "config.yaml")):
        raise UserError(
            "The package has its own config.yaml, which cannot be replaced; give one of another "
            "name by --config-dir=DIR --config-name=NAME, and begin it with defaults: [config, "
            "_self_]. The overrides of a run stand in its .hydra/overrides.yaml."
        )
    overrides = given.overrides
    return [item for item in arguments if item not in overrides], overrides
