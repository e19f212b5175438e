"""Turn what Hydra says of a mistyped command line into one sentence with near matches."""

import difflib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.errors import MissingConfigException, OverrideParseException
from omegaconf import DictConfig, OmegaConf

from tex_lightning.errors import UserError

OVERRIDE = re.compile(r"^(?P<prefix>[+~]{0,2})(?P<key>[\w./@-]+)(?:=(?P<value>.*))?$", re.DOTALL)
MERGING = "Error merging override "
# What OmegaConf says of a value of the wrong type, and what to give instead.
TYPES = {
    "could not be converted to Integer": "a whole number",
    "could not be converted to Float": "a number",
    "is not a valid bool": "true or false",
    "to string": "text",
    "is not Optional": "a value other than null",
    "is not a ListConfig": "a list, as in [0,1]",
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
        given = str(error).removeprefix(MERGING)
        return UserError(f"{given} is not of the right type; give {wanted}.")
    if isinstance(error, OverrideParseException):
        return _unreadable(error.override)
    overrides = [argument for argument in arguments if not argument.startswith("-")]
    try:
        groups, keys = config_groups(conf), list(config_keys(conf))
    except Exception:  # a broken configuration is not the user's typing
        return UserError(_one_line(error))
    for override in overrides:
        match = OVERRIDE.match(override)
        if match is None:
            return _unreadable(override)
        complaint = _check(match["key"], match["value"], match["prefix"], groups, keys)
        if complaint is not None:
            return complaint
    if isinstance(error, MissingConfigException) and error.options:  # of a group of Hydra's
        group, _, option = str(error.missing_cfg_file).rpartition("/")
        return _unknown_option(group, option, error.options)
    return UserError(_one_line(error))


def _unreadable(override: str) -> UserError:
    if "=" not in override:
        return UserError(f"{override!r} has no value; write it as key=value.")
    return UserError(
        f"{override!r} cannot be read as key=value; put quotes of two kinds around a value with "
        "spaces or signs, as in 'haptic=\"my file (1).wav\"'."
    )


def _unknown_option(group: str, option: str, options: Sequence[str]) -> UserError:
    more = ', or install what brings it (pip install ".[parallel]")' if group == LAUNCHERS else ""
    return UserError(
        f"{group}={option} does not exist{_near(option, options)}; "
        f"choose one of {', '.join(sorted(options))}{more}."
    )


def config_groups(conf: Path) -> dict[str, list[str]]:
    """Options of every configuration group."""
    groups: dict[str, list[str]] = {}
    for file in sorted(conf.rglob("*.yaml")):
        group = file.parent.relative_to(conf).as_posix()
        if group != "." and file.stem != "base":
            groups.setdefault(group, []).append(file.stem)
    for group in list(groups):  # options in a subfolder, as in experiment=paper/haptic
        parent, _, name = group.rpartition("/")
        if parent == "experiment":
            groups.setdefault(parent, []).extend(f"{name}/{option}" for option in groups[group])
    return groups


def config_keys(conf: Path) -> Iterator[str]:
    """Dotted keys of the whole configuration, sections included."""
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(conf), version_base="1.3"):
        yield from _keys(compose("config"), "")


def _keys(config: DictConfig, prefix: str) -> Iterator[str]:
    for key in map(str, config):
        yield f"{prefix}{key}"
        if not OmegaConf.is_missing(config, key) and isinstance(config[key], DictConfig):
            yield from _keys(config[key], f"{prefix}{key}.")


def _check(
    key: str, value: str | None, prefix: str, groups: dict[str, list[str]], keys: list[str]
) -> UserError | None:
    group = key.partition("@")[0]
    if group in HYDRA_OWN or group.startswith(("hydra.", "hydra/")):
        return None
    if value is None and not prefix.startswith("~"):
        return _unreadable(key)
    if group in groups:
        wrong = [item for item in (value or "").split(",") if item not in groups[group]]
        if wrong and "(" not in (value or ""):
            return _unknown_option(group, wrong[0], groups[group])
        return None
    if key not in keys and prefix != "+":
        return UserError(
            f"There is no key {key}{_near(key, sorted({*keys, *groups}))}; "
            "`python -m tex_lightning --help` lists all."
        )
    return None


def _near(word: str, candidates: Sequence[str]) -> str:
    """Near matches of a whole dotted key, or of its last part where the path is wrong."""
    close = difflib.get_close_matches(word, candidates, n=3, cutoff=0.6)
    if not close:
        leaf = word.rpartition(".")[2]
        leaves = {candidate.rpartition(".")[2]: candidate for candidate in candidates}
        close = [leaves[name] for name in difflib.get_close_matches(leaf, leaves, n=3, cutoff=0.6)]
    return f" (did you mean {' or '.join(dict.fromkeys(close))}?)" if close else ""


def _one_line(error: Exception) -> str:
    """The messages of an error and its cause as one line that ends in a full stop."""
    parts = [str(error)]
    if error.__cause__ is not None and str(error.__cause__) not in parts[0]:
        parts.append(str(error.__cause__))
    lines = [line.strip() for part in parts for line in part.splitlines()]
    noise = ("full_key:", "object_type=", "reference_type=", "See https:", "Set the environment")
    kept = [line.rstrip(".") for line in lines if line and not line.startswith(noise)]
    return "; ".join(dict.fromkeys(kept)) + "."
