"""Find configuration folders and their options: of the package, the user and installed plug-ins.

The user's are those of ``--config-dir``, and a plug-in's is the ``conf`` of an installed package
with an entry point in the group ``tex_lightning.plugins``. Senses are also found in
``hydra.searchpath``.
"""

import re
import sys
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache, lru_cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path

import yaml
from hydra.core.config_search_path import ConfigSearchPath
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import DictConfig, OmegaConf

from tex_lightning.config.model import ModelConfig
from tex_lightning.errors import UserError, shorten
from tex_lightning_runtime.files import expanded

INSIDE = Path(__file__).parents[1] / "conf"  # in an installed wheel
BESIDE = Path(__file__).parents[2] / "conf"  # in a checkout
CONF = INSIDE if INSIDE.is_dir() else BESIDE
VARIANTS = CONF / "variants.yaml"
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # of a library that may lack its quick one
ENTRY_POINTS = "tex_lightning.plugins"
FLAG = "--config-dir"  # Hydra's

_GIVEN: list[Path] = []  # by --config-dir of this process


class UserFolders(SearchPathPlugin):
    """Adds the folders to Hydra's search path, behind the package's own."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Append one entry for each folder."""
        for folder in user_folders():
            search_path.append("tex_lightning.plugins", f"file://{folder}")


def with_own_senses(overrides: Sequence[str]) -> list[str]:
    """Return the overrides, and those that compose the senses in ``sense/`` of a user's folders.

    ``model.senses`` may name them then, as it does those of the package.

    Raises:
        UserError: If a file has a name that none can have.
    """
    folders = [*user_folders(), *named_folders(overrides)]
    files = [file for folder in folders for file in folder.glob("sense/[!.]*.yaml")]
    names = {file.stem: file for file in files if not _is_fragment(file, overrides)}
    ours = {file.stem for file in (CONF / "sense").glob("*.yaml")}
    senses = sorted(names.keys() - ours - {"base"})  # base is what others begin with
    if wrong := next((name for name in senses if not _is_free(name)), None):
        raise UserError(
            f"{names[wrong]} cannot be a sense, whose name is of English letters, digits and _ "
            "and no other key of model; rename it."
        )
    added = [f"+sense@model.{name}={name}" for name in senses]
    return [*overrides, *(item for item in added if item not in overrides)]


def is_added(override: str) -> bool:
    """Return whether :func:`with_own_senses` adds an override, which nobody needs to read."""
    return re.fullmatch(r"\+sense@model\.([\w-]+)=\1", override) is not None


def _is_free(name: str) -> bool:
    """Return whether a sense can have a name: Hydra reads it, and no key of the model has it."""
    taken = hasattr(ModelConfig, name) or name in ModelConfig.__annotations__
    return re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]*", name) is not None and not taken


def _is_fragment(file: Path, overrides: Sequence[str]) -> bool:
    """Return whether a file has no class and is not asked for: other senses begin with it."""
    with suppress(OSError, ValueError):  # what cannot be read is told when it is composed
        text = file.read_text(encoding="utf-8")
        asked = any(x.startswith("model.senses=") and file.stem in x for x in overrides)
        return not asked and "_target_" not in text and "defaults" not in text
    return False


def named_folders(overrides: Sequence[str]) -> Iterator[Path]:
    """Yield folders that ``hydra.searchpath=[file://DIR,…]`` names.

    Raises:
        UserError: If one is not there, of which Hydra would warn in lines of code.
    """
    for override in overrides:
        key, _, value = override.partition("=")
        if key == "hydra.searchpath":
            for entry in value.strip("[]").split(","):
                place = entry.strip(" '\"").removeprefix("file://")
                if not Path(place).is_dir() and not any(sign in place for sign in ("://", "${")):
                    raise UserError(f"hydra.searchpath names {place}, which is no folder.")
                yield Path(place)


def installed_packages() -> list[str]:
    """Return top packages that registered themselves under the entry-point group."""
    return [*_packages_on(tuple(sys.path))]


@lru_cache(maxsize=1)
def _packages_on(path: tuple[str, ...]) -> tuple[str, ...]:
    """Return them for these folders, in which the files of every installed package are read."""
    plugins = entry_points(group=ENTRY_POINTS)
    return tuple(sorted({entry.module.partition(".")[0] for entry in plugins}))


def user_folders() -> list[Path]:
    """Return the command line's folders, then the ``conf`` of every registered package."""
    specs = map(find_spec, installed_packages())  # which imports none of them
    homes = (home for spec in specs for home in (spec and spec.submodule_search_locations) or ())
    folders = (Path(home) / "conf" for home in homes)
    return [*_GIVEN, *(folder for folder in folders if folder.is_dir())]


@cache
def variants() -> dict[str, DictConfig]:
    """Return the options of a few lines by GROUP/NAME, which have no file of their own."""
    nodes = OmegaConf.create(yaml.load(VARIANTS.read_text(encoding="utf-8"), LOADER))
    return {f"{group}/{name}": nodes[group][name] for group in nodes for name in nodes[group]}


def config_groups() -> dict[str, list[str]]:
    """Return options of every configuration group, the user's behind those of the package."""
    groups: dict[str, list[str]] = {}
    names = sorted([*variants(), *_files(CONF)])
    for name in [*names, *(each for folder in user_folders() for each in _files(folder))]:
        group, _, option = name.partition("/")
        hidden = group in ("hydra", "debug") and "/" in option  # not a person's to choose
        hidden |= option.rpartition("/")[2] == "base"
        if not hidden and option not in groups.get(group, ()):
            groups.setdefault(group, []).append(option)
    return groups


def _files(folder: Path) -> list[str]:
    """Return GROUP/OPTION of every configuration file in a folder."""
    files = sorted(folder.rglob("*.yaml"))
    names = [file.relative_to(folder).with_suffix("").as_posix() for file in files]
    return [name for name in names if "/" in name]


def check_text(arguments: Sequence[object]) -> None:
    """Reject arguments that are no text, such as a list of them all.

    Raises:
        UserError: Naming the first.
    """
    for argument in arguments:
        if not isinstance(argument, str):
            raise UserError(
                f"{shorten(repr(argument))} is no argument of a command line; give each as text, "
                "as in 'data.root=DIR'."
            )


def use_config_dir(arguments: Sequence[str]) -> list[str]:
    """Set the folders of each ``--config-dir`` as sources of configuration files.

    The current folder becomes importable with one, as ``python -m`` makes it and an installed
    command does not, and so does the folder around it: classes beside the files are found.

    Returns:
        The other arguments.

    Raises:
        UserError: If there is no such folder, or an argument is no text.
    """
    check_text(arguments)
    _GIVEN.clear()
    parser = ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    parser.add_argument(FLAG, dest="folders", nargs="?", const="", action="append", default=[])
    options, others = parser.parse_known_args(arguments)
    for given in options.folders:
        folder = expanded(given).resolve()
        if not given or not folder.is_dir():
            raise UserError(
                f"--config-dir={given} is no folder; give the one with your data/NAME.yaml, "
                "model/NAME.yaml and so on."
            )
        _GIVEN.append(folder)
        for home in dict.fromkeys((Path.cwd(), folder.parent)):
            if str(home) not in sys.path and not (home == Path.cwd() and "" in sys.path):
                sys.path.append(str(home))
    return others
