"""Compose this package's configuration and run a job with it, wherever Hydra is at the time.

Beside that stand the job that Hydra has begun, the keys that a composed task reads, and the flags
of a command line.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NoReturn

from hydra import compose, initialize_config_dir
from hydra._internal.callbacks import Callbacks
from hydra._internal.utils import get_args_parser
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.utils import JobRuntime, run_job
from hydra.errors import HydraException
from hydra.types import HydraContext, RunMode
from hydra.version import VersionBase
from omegaconf import DictConfig, OmegaConf

from tex_lightning.config import CONF, Config, flatten, register
from tex_lightning.config.keys import Key, walk
from tex_lightning.config.model import FUSION, PACKAGE_SENSES, PhotoConfig, SignalConfig
from tex_lightning.config.search import with_own_senses
from tex_lightning.config.tasks import READS
from tex_lightning.core.files import matches
from tex_lightning.errors import UserError, reason

NAME = "config"


def compose_config(
    conf: Path, overrides: Sequence[str] = (), searchpath: Sequence[str] = ()
) -> DictConfig:
    """The configuration as a command line composes it.

    Args:
        conf: Folder of the configuration files.
        overrides: Such as ``model=haptic``.
        searchpath: Further folders with configuration files, as ``file://DIR``.

    Raises:
        HydraException: If an override is wrong.
    """
    folders = ",".join('"{}"'.format(folder.replace('"', '\\"')) for folder in searchpath)
    more = [f"hydra.searchpath=[{folders}]"] if searchpath else []
    with _hydra(conf):
        return compose(NAME, overrides=[*with_own_senses(overrides), *more])


def run_composed(function: Callable[[DictConfig], Any], overrides: Sequence[str]) -> Any:  # noqa: ANN401
    """Call a function as Hydra's command line would, in a run folder, and return what it returns.

    Logging and the working directory stay the caller's.

    Raises:
        UserError: If the overrides ask for a sweep.
        Exception: What the function raises, or Hydra of a wrong override.
    """
    raised: list[Exception] = []

    def guarded(composed: DictConfig) -> Any:  # noqa: ANN401
        try:
            return function(composed)
        except Exception as error:  # Hydra would print a line of its own
            raised.append(error)

    with _hydra(CONF):
        config = compose(NAME, overrides=with_own_senses(overrides), return_hydra_config=True)
        if config.hydra.mode == RunMode.MULTIRUN:
            raise UserError(
                "These overrides ask for a sweep; run it by python -m tex_lightning, or call this "
                "once for each job."
            )
        context = HydraContext(GlobalHydra.instance().config_loader(), Callbacks(config))
        finished = run_job(guarded, config, "hydra.run.dir", None, context, False)
    if raised:
        raise raised[0]
    return finished.return_value


@contextmanager
def _hydra(conf: Path) -> Iterator[None]:
    """Initialise Hydra for this package; afterwards it is as the caller's application left it."""
    register()
    running, base = GlobalHydra.instance().hydra, VersionBase.instance().version_base
    GlobalHydra.instance().clear()
    try:
        with initialize_config_dir(str(conf), JobRuntime.instance().get("name"), "1.3"):
            yield
    finally:
        GlobalHydra.instance().hydra = running
        VersionBase.instance().version_base = base


Origin = Literal["command", "sweep", "python"]
RUN_FOLDER = "hydra.run.dir="
ASKED_FOR = ("command-line", "hydra.searchpath in command-line")  # providers of further folders


@dataclass(frozen=True)
class Job:
    """One run of one task, in plain values.

    Attributes:
        overrides: What was given, without Hydra's own keys, such as ``model=haptic``.
        directory: The run folder, an absolute path.
        origin: Whether a command line runs it, a sweep with others, or a program in Python.
        named: Whether the run folder was given, not made up.
        searchpath: Further folders with configuration files, as ``file://DIR``.
        hydra: All of Hydra's own settings, for the record.
    """

    overrides: tuple[str, ...]
    directory: Path
    origin: Origin
    named: bool
    searchpath: tuple[str, ...]
    hydra: DictConfig

    def compose(self, overrides: Sequence[str]) -> DictConfig:
        """Compose another configuration from the same folders.

        Raises:
            HydraException: If an override is wrong.
        """
        return compose_config(CONF, overrides, self.searchpath)


def current_job(*, python: bool = False) -> Job:
    """The job that Hydra has just begun; nothing below asks Hydra again.

    Args:
        python: Whether a program in Python runs it.
    """
    hydra = HydraConfig.get()
    sources = hydra.runtime.config_sources
    return Job(
        overrides=tuple(hydra.overrides.task),
        directory=Path(hydra.runtime.output_dir).resolve(),
        origin="python" if python else "sweep" if hydra.mode == RunMode.MULTIRUN else "command",
        named=any(each.startswith(RUN_FOLDER) for each in hydra.overrides.hydra),
        searchpath=tuple(
            f"{each.schema}://{each.path}" for each in sources if each.provider in ASKED_FOR
        ),
        hydra=OmegaConf.create({"hydra": hydra}),
    )


EVERYWHERE = ("task", "verbose")  # every task reads these


def keys_read(config: DictConfig) -> dict[str, Key]:
    """Return metadata of the keys that ``config.task`` reads for ``config.model``, by name."""
    task, model = config.task, config.model
    used = () if model.baseline else (*model.senses,)
    if task == "frontier":  # whose family has any of them
        used = (*PACKAGE_SENSES, FUSION)
    used += (FUSION,) if len(used) > 1 else ()
    unused = tuple(f"model.{name}." for name in (*PACKAGE_SENSES, FUSION) if name not in used)
    read = tuple(f"{part}." for part in (*EVERYWHERE, *READS[task]))
    trains = "trainer" in READS[task]
    keys = {
        name: key
        for name, key in walk(Config)
        if f"{name}.".startswith(read)
        and not name.startswith(unused)
        and (trains or ".fit." not in name)
    }
    own = {*used} - {*PACKAGE_SENSES, FUSION} if "model" in READS[task] else ()
    for sense in own:
        keys |= _own_keys(f"model.{sense}", model.get(sense))
    return keys


def _own_keys(where: str, node: object) -> dict[str, Key]:
    """Return the keys of a user's sense, with the schema's meaning where it has one."""
    known = dict((*walk(PhotoConfig), *walk(SignalConfig)))
    values: Any = OmegaConf.to_container(node, resolve=False) if OmegaConf.is_dict(node) else {}
    names = [name for name in flatten(values) if not name.rpartition(".")[2].startswith("_")]
    return {
        f"{where}.{name}": known.get(name, Key("for the class that is named beside it"))
        for name in names
    }


# whose values name files
KEYS = ("haptic", "image", "sound", "checkpoint", "data.root", "data.manifest")
OWN_SENSE = re.compile(r"\+\w+")  # a key beside those of the schema


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
    return [each for each in arguments if each not in overrides], overrides


def quote_files(arguments: Sequence[str]) -> list[str]:
    """Add quotes to names of files that Hydra's grammar would misread, as ``haptic=my file.wav``.

    A pattern that matches files is such a name, too. Everything else stays as it is.
    """
    parser, quoted = OverridesParser.create(), []
    for argument in arguments:
        key, _, value = argument.partition("=")
        names_files = key in KEYS or OWN_SENSE.fullmatch(key)
        if names_files and _names_files(value) and _misread(parser, argument):
            # Hydra reads backslashes literally, except before a quote
            escaped = re.sub(r'(\\*)("|$)', lambda found: 2 * found[1] + _quote(found[2]), value)
            argument = f'{key}="{escaped}"'
        quoted.append(argument)
    return quoted


def _quote(mark: str) -> str:
    return f"\\{mark}" if mark else ""


def _names_files(value: str) -> bool:
    try:
        path = Path(value).expanduser()
        return bool(value) and (path.exists() or bool(matches(str(path))))
    except (OSError, RuntimeError, ValueError):  # too long, no such user, a null character
        return False


def _misread(parser: OverridesParser, argument: str) -> bool:
    """Whether Hydra fails to read the value as the text that it is."""
    try:
        return bool(parser.parse_override(argument).value() != argument.partition("=")[2])
    except HydraException:
        return True
