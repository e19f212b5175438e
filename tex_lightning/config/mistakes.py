"""Turn Hydra's error for a mistyped command line into one sentence with near matches."""

import difflib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from tex_lightning.config import READ_FILES
from tex_lightning.config.composition import compose_config, keys_read
from tex_lightning.config.instantiation import TARGET
from tex_lightning.config.search import split_config_dir, user_folders
from tex_lightning.errors import UserError, shorten

MISTAKES = (HydraException, OmegaConfBaseException, YAMLError)  # the last of a user's own files

OVERRIDE = re.compile(r"^(?P<prefix>[+~]{0,2})(?P<key>[\w./@-]+)(?:=(?P<value>.*))?$", re.DOTALL)
MERGING = "Error merging override "
AMBIGUOUS = "Ambiguous value for argument '"
DIGITS = "integer string conversion"  # what Python says of thousands of digits
# What OmegaConf says of a value of the wrong type, and what to give instead.
TYPES = {
    "could not be converted to Integer": "a whole number",
    "could not be converted to Float": "a number",
    "is not a valid bool": "true or false",
    "to string": "text",
    "is not Optional": "a value other than null",
    "is not a ListConfig": "a list, as in {0}=[{2}]",
    "to Dict[": "a value to one of its keys, or choose it by its group, as in trunk=NAME",
    "is not a subclass of": "a value to one of its keys",
}
HYDRA_OWN = ("hydra", "hydra/")
LAUNCHERS = "hydra/launcher"


def explain(error: Exception, arguments: Sequence[str], conf: Path) -> UserError:
    """Name the wrong argument and what was probably meant.

    Args:
        error: What Hydra or OmegaConf raised.
        arguments: The command line after the program's name.
        conf: Folder of the configuration files.
    """
    wanted = next((give for said, give in TYPES.items() if said in str(error.__cause__)), None)
    if wanted is not None and str(error).startswith(MERGING):
        given = shorten(str(error).removeprefix(MERGING))
        wanted = wanted.format(*given.partition("="))
        return UserError(f"{given} is not of the right type; give {wanted}.")
    if isinstance(error, OverrideParseException):
        return _unreadable(error.override)
    if str(error).startswith(AMBIGUOUS):
        given = str(error).removeprefix(AMBIGUOUS).partition("'\n")[0]
        return UserError(
            f"{shorten(given)} has several values; add -m to run a job for each, or put a list in "
            "brackets, as in [0,1]."
        )
    _, rest = split_config_dir(arguments)
    overrides = [argument for argument in rest if not argument.startswith("-")]
    if isinstance(error, RecursionError):
        return UserError(
            "The command line or a configuration file is nested too deeply; take brackets out."
        )
    if isinstance(error, OverflowError) or DIGITS in str(error):
        longest = shorten(max(overrides, key=len, default=""))
        return UserError(f"{longest} has too many digits; give a smaller number.")
    try:
        groups = config_groups(conf)
        config = compose_config(conf, _chosen(overrides, groups))
    except Exception:  # a broken configuration is not the user's typing
        return UserError(_one_line(error))
    for override in overrides:
        match = OVERRIDE.match(override)
        if match is None:
            return _unreadable(override)
        complaint = _check(match["key"], match["value"], match["prefix"], groups, config)
        if complaint is not None:
            return complaint
    if isinstance(error, MissingConfigException) and error.options:  # of a group of Hydra's
        group, _, option = str(error.missing_cfg_file).rpartition("/")
        return unknown_option(group, option, error.options)
    return UserError(_one_line(error))


def _unreadable(override: str) -> UserError:
    given = shorten(repr(override))
    if "=" not in override:
        return UserError(f"{given} has no value; write it as key=value, without spaces.")
    return UserError(
        f"{given} cannot be read as key=value; put quotes of two kinds around a value with spaces "
        "or signs, as in 'haptic=\"my file (1).wav\"'."
    )


def unknown_option(group: str, option: str, options: Sequence[str]) -> UserError:
    """The error for an option that its group does not have."""
    more = ', or install what brings it (pip install ".[parallel]")' if group == LAUNCHERS else ""
    return UserError(
        f"{group}={shorten(option)} does not exist{_did_you_mean(_close(option, options))}; "
        f"choose one of {', '.join(sorted(options))}{more}."
    )


def config_groups(conf: Path) -> dict[str, list[str]]:
    """Options of every configuration group, the user's behind those of ``conf``."""
    groups: dict[str, list[str]] = {}
    for folder in (conf, *user_folders()):
        for file in sorted(folder.rglob("*.yaml")):
            group = file.parent.relative_to(folder).as_posix()
            inner = group == "." or group.startswith("debug/")  # not a person's to choose
            if not inner and file.stem not in ("base", *groups.get(group, ())):
                groups.setdefault(group, []).append(file.stem)
    for group in list(groups):  # options in a subfolder, as in experiment=paper/haptic
        parent, _, name = group.rpartition("/")
        if parent == "experiment":
            groups.setdefault(parent, []).extend(f"{name}/{option}" for option in groups[group])
    return groups


def _keys(values: dict[str, Any], prefix: str = "") -> Iterator[str]:
    for key, value in values.items():
        yield f"{prefix}{key}"
        if isinstance(value, dict):
            yield from _keys(value, f"{prefix}{key}.")


def _check(
    key: str, value: str | None, prefix: str, groups: dict[str, list[str]], config: DictConfig
) -> UserError | None:
    group = key.partition("@")[0]
    if group in HYDRA_OWN or group.startswith(("hydra.", "hydra/")):
        return None
    if value is None and not prefix.startswith("~"):
        return _unreadable(key)
    if group in groups:
        items = (item.strip(" []'\"") for item in (value or "").split(","))  # a list or a sweep
        wrong = [item for item in items if item not in groups[group]]
        if wrong and "(" not in (value or ""):
            return unknown_option(group, wrong[0], groups[group])
        return None
    values: Any = OmegaConf.to_container(config, resolve=False)
    keys = list(_keys(values))
    if key in keys or prefix == "+":
        return None
    return unknown_key(key, config, keys, groups)


def unknown_key(
    key: str,
    config: DictConfig,
    keys: Sequence[str] = (),
    groups: Sequence[str] | dict[str, Any] = (),
) -> UserError:
    """The mistake of giving a key that there is not.

    Args:
        key: Its dotted name.
        config: As composed without it.
        keys: All that are in there.
        groups: Groups of the configuration.
    """
    if OmegaConf.is_dict(config.model.get(key)):  # a sense
        readers = ", ".join(f"task={task}" for task in READ_FILES)
        return UserError(f"{key}=FILE is read by {readers} alone; leave it out.")
    near = _near_in_node(key, keys) or _close(key, [*groups]) or _near_keys(key, config)
    return UserError(
        f"There is no key {shorten(key)}{_did_you_mean(near or _close(key, keys))}; "
        "`python -m tex_lightning --help=all` lists all."
    )


def _chosen(overrides: Sequence[str], groups: dict[str, list[str]]) -> list[str]:
    """The overrides that choose an option which exists, such as ``model=fusion``."""
    pairs = (override.partition("=") for override in overrides)
    return [f"{group}={option}" for group, _, option in pairs if option in groups.get(group, ())]


def _near_in_node(word: str, keys: Sequence[str]) -> list[str]:
    """Keys beside a wrong one in a node that names a class, whose keys the schema does not know."""
    node, _, leaf = word.rpartition(".")
    if f"{node}.{TARGET}" not in keys:
        return []
    own = [key.rpartition(".")[2] for key in keys if key.rpartition(".")[0] == node]
    return [f"{node}.{name}" for name in _close(leaf, own)]


def _near_keys(word: str, config: DictConfig) -> list[str]:
    """Keys of the chosen task and model that a wrong one may stand for, the likeliest rule first.

    The end of a dotted key (``fit.epochs``), a slip (``model.haptic.widht``), the name of a key
    below another path (``data.epochs``), a slip in the name alone, or its initials (``lr``).
    """
    keys = list(keys_read(config))
    leaf = word.rpartition(".")[2]
    leaves = {key: key.rpartition(".")[2] for key in keys}
    like = difflib.get_close_matches(leaf, set(leaves.values()), n=1)
    rules = (
        [key for key in keys if key.endswith(f".{word}")],
        _close(word, keys),
        [key for key, name in leaves.items() if name == leaf],
        [key for key, name in leaves.items() if name in like],
        [key for key, name in leaves.items() if leaf == "".join(w[:1] for w in name.split("_"))],
    )
    return next(filter(None, rules), [])


def _close(word: str, candidates: Sequence[str]) -> list[str]:
    return list(dict.fromkeys(difflib.get_close_matches(word, candidates, n=3)))


def _did_you_mean(near: Sequence[str]) -> str:
    return f" (did you mean {' or '.join(near)}?)" if near else ""


def _one_line(error: Exception) -> str:
    """The messages of an error and its cause as one line that ends in a full stop."""
    parts = [str(error)]
    if error.__cause__ is not None and str(error.__cause__) not in parts[0]:
        parts.append(str(error.__cause__))
    lines = [line.strip() for part in parts for line in part.splitlines()]
    noise = ("full_key:", "object_type=", "reference_type=", "See https:", "Set the environment")
    kept = [line.rstrip(".") for line in lines if line and not line.startswith(noise)]
    return "; ".join(dict.fromkeys(map(shorten, kept))) + "."
