"""Explain the errors that a user can mend in one sentence, those of Hydra with near matches."""

import errno
import re
from collections.abc import Iterator
from difflib import get_close_matches
from typing import Any

from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from tex_lightning.config import CONF, READ_FILES, variants
from tex_lightning.config.keys import nearest
from tex_lightning.config.user_folders import user_folders
from tex_lightning.core.contract import fault_of, rejected_by_library
from tex_lightning.core.files import UNWRITABLE, unwritable
from tex_lightning.errors import UserError, reason, shorten

MISTAKES = (HydraException, OmegaConfBaseException, YAMLError)  # the last of a user's own files
KEY = re.compile(r"Could not (?:override|append to config|delete).*?'([^'=]+)")
# Options that have another name now, by group and former name.
RENAMED = {
    ("model", "haptic_bands"): "band_proportions",
    ("sense", "bands"): "band_proportions",
}
NO_LIST = "is not a ListConfig, list or tuple"  # words of OmegaConf
MANY = 4  # keys that a wrong one may stand for
NOISE = ("full_key:", "object_type=", "reference_type=", "See https:", "Set the environment", "To ")


def to_user_error(error: Exception, *, began: bool) -> UserError | None:
    """Return an error as one that the user can mend; None if it is a fault of the program.

    Args:
        error: Error that ended the job.
        began: Whether the job had a run folder; before, only its configuration can be wrong.
    """
    if isinstance(error, UserError):
        return error
    if fault_of(error) is not None:  # of the user's own code, which keeps its traceback
        return None
    if (said := rejected_by_library(error)) is not None:
        return UserError(said)
    if isinstance(error, MISTAKES):
        return explain(error)
    if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
        return UserError(f"The path {shorten(error.filename)} is too long; give a shorter one.")
    if began:
        if isinstance(error, OSError) and error.errno in UNWRITABLE:
            return unwritable(shorten(error.filename or "a file of this run"), error)
        return None
    if isinstance(error, OSError):
        return UserError(
            f"The run folder cannot be made ({shorten(error)}); choose another hydra.run.dir."
        )
    if isinstance(error, ValueError | OverflowError | RecursionError):
        return UserError(
            f"The command line or a configuration file cannot be read ({reason(error)}); give "
            "other values."
        )
    return None


def explain(error: Exception) -> UserError:
    """Explain an error of Hydra or OmegaConf in one sentence, with near matches."""
    if isinstance(error, OverrideParseException):
        return UserError(
            f"{shorten(repr(error.override))} cannot be read; write key=value without spaces, or "
            "put quotes of two kinds around a value with spaces or signs, as in "
            "'haptic=\"my file (1).wav\"'."
        )
    wrong = str(getattr(error, "missing_cfg_file", ""))
    group, _, option = wrong.rpartition("/")
    if isinstance(error, MissingConfigException) and group:
        options = error.options or [  # there are none of a list of options
            file.stem
            for folder in (CONF, *user_folders())
            for file in (folder / group).glob("*.yaml")
        ]
        if not options:  # an experiment, whose name has a folder, as in few/haptic
            group, _, option = wrong.partition("/")
            files = [x.relative_to(CONF).with_suffix("") for x in (CONF / group).rglob("*.yaml")]
            names = [*variants(), *(file.as_posix() for file in files)]
            options = [x.removeprefix(f"{group}/") for x in names if x.startswith(f"{group}/")]
        options = [each for each in options if each.rpartition("/")[2] != "base"]
        if name := RENAMED.get((group, option)):
            return UserError(f"{group}={option} does not exist: it is called {group}={name} now.")
        return UserError(
            f"{group}={shorten(option)} does not exist{nearest(option, options)}; "
            f"choose one of {', '.join(sorted(options))}."
        )
    match, root = KEY.search(str(error)), getattr(error.__cause__, "parent_node", None)
    if match and root is not None and not str(error.__cause__).startswith("Value "):
        return unknown_key(match[1], root._get_root())
    return UserError(_one_line(error))


def unknown_key(key: str, config: DictConfig) -> UserError:
    """Return the error for a key that there is not."""
    near = [name for name in _near_keys(key, config) if name != f"model.{key}"]  # a sense
    if key.isidentifier() and not near and config.get("task") in READ_FILES:
        return UserError(
            f"There is no key {shorten(key)}; files of a modality of your own are given with a "
            f"plus sign, as +{key}=FILE, and `python -m tex_lightning --help=all` lists all keys."
        )
    meant = f" (did you mean {' or '.join(near)}?)" if near else ""
    return UserError(
        f"There is no key {shorten(key)}{meant}; `python -m tex_lightning --help=all` lists all."
    )


def _near_keys(word: str, config: DictConfig) -> list[str]:
    """Return keys that a wrong one may stand for, the likeliest rule first.

    These are a slip in the whole name (``model.haptic.widht``), the end of a dotted key
    (``fit.epochs``), its name in another section, a slip in that, and its initials (``lr``).
    """
    values: Any = OmegaConf.to_container(config, resolve=False)
    others = (name for name in _names(values) if not f"{name}.".startswith(f"{word}."))
    names = {name: name.rpartition(".")[2] for name in others}
    leaf = word.rpartition(".")[2]
    like = get_close_matches(leaf, sorted({*names.values()}), n=1)
    rules = (
        [name for name in names if name.endswith(f".{word}")],
        get_close_matches(word, names, n=1, cutoff=0.8),
        [name for name in names if names[name] in like],
        [name for name in names if leaf == "".join(w[:1] for w in names[name].split("_"))],
    )
    return next(filter(None, rules), [])[:MANY]


def _names(values: dict[Any, Any], prefix: str = "") -> Iterator[str]:
    """Yield the dotted names of all sections and keys."""
    for name, value in values.items():
        yield f"{prefix}{name}"
        if isinstance(value, dict):
            yield from _names(value, f"{prefix}{name}.")


def refusal(line: str) -> str:
    """Return what OmegaConf says of a value in words of the command line."""
    line = re.sub("^field '.*' is not Optional$", "it takes no null, give a value", line)
    return re.sub(f".*{NO_LIST}.*", "give a list, as in [A,B]", line)


def _one_line(error: Exception) -> str:
    """Return the messages of an error and its cause as one line that ends in a full stop."""
    lines = [line for part in (error, error.__cause__) if part for line in str(part).splitlines()]
    kept = [line.strip().rstrip(".") for line in lines if not line.strip().startswith(NOISE)]
    kept = [re.sub("^Error merging override (.*)", r"\1 cannot be used", line) for line in kept]
    kept = [refusal(line) for line in kept]
    return "; ".join(dict.fromkeys(map(shorten, filter(None, kept)))) + "."
