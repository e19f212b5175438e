"""Explain the errors that a user can mend in one sentence, those of Hydra with near matches."""

import errno
import re
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from traceback import walk_tb
from typing import Any

from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import (
    InterpolationResolutionError,
    OmegaConfBaseException,
    UnsupportedInterpolationType,
)
from yaml import YAMLError

from tex_lightning.config import CONF, READ_FILES
from tex_lightning.config.user_folders import config_groups, named_folders, user_folders
from tex_lightning.core.contract import fault_of, rejected_by_library
from tex_lightning.core.files import UNWRITABLE, unwritable
from tex_lightning.errors import UserError, nearest, reason, shorten

MISTAKES = (HydraException, OmegaConfBaseException, YAMLError)  # the last of a user's own files
SAME_NAME = re.compile("'(.+)/(.+)' is validated against ConfigStore schema")
KEY = re.compile(r"Could not (?:override|delete from config\.) '([^'=]+)")
# Options that have another name now, by group and former name.
RENAMED = {("model", "haptic_bands"): "band_proportions", ("sense", "bands"): "band_proportions"}
EXTRAS = {  # of this package, by the option of hydra/launcher or hydra/sweeper that each brings
    "joblib": "parallel",
    "submitit_local": "parallel",
    "submitit_slurm": "parallel",
    "optuna": "optuna",
}
WORDS = {  # of Hydra and OmegaConf, and ours
    "^field '.*' is not Optional$": "it takes no null, give a value",
    ".*is not a ListConfig, list or tuple.*": "give a list, as in [A,B]",
    "^Value .* could not be converted to Float$": "give a number",
    "^Value .* could not be converted to Integer$": "give a whole number",
    "^Value .* is not a valid bool .*": "give true or false",
    "^Cannot convert .* to string: .*": "give text",
    ".*does not support deletion$": "it cannot be taken away, give another value",
    "^Could not delete from config. '(.*)' does not exist$": r"\1 is null already",
    "^Cannot merge DictConfig with ListConfig$": "one of names and values, and a list, is given",
    "^Config group override must be a string or a list.*": "an option is a name, or left out by "
    "~GROUP, as in ~logger",
    "^Key '(experiment|debug)' not in 'Config'$": "begin this file with # @package _global_",
    r"^Multiple values for (\w+)\. To override a value.*": r"\1 has an option already, give "
    r"\1=NAME without a plus sign, or - override /\1: NAME in a file",
}
NO_TRIAL = "No trials are completed yet."  # of Optuna, where all of them failed
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
    if str(error) == NO_TRIAL:
        return UserError("No trial of this search succeeded; correct what the errors above say.")
    if began:
        if isinstance(error, OSError) and error.errno in UNWRITABLE:
            return unwritable(shorten(error.filename or "a file of this run"), error)
        return None
    if isinstance(error, OSError) and error.filename is None:  # of what is printed
        return UserError(f"The output cannot be written ({reason(error)}); send it elsewhere.")
    if isinstance(error, OSError):
        return UserError(
            f"The run folder cannot be made ({shorten(error)}); choose another hydra.run.dir."
        )
    modules = [frame.f_globals.get("__name__") for frame, _ in walk_tb(error.__traceback__)]
    below_a_value = modules[-1:] == [OmegaConf.__module__]
    if below_a_value or isinstance(error, ValueError | OverflowError | RecursionError):
        said = "a key stands below a list or a value" if below_a_value else refusal(reason(error))
        return UserError(
            f"The command line or a configuration file cannot be read ({said}); give other values."
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
    if isinstance(error, MissingConfigException) and wrong.rpartition("/")[0]:
        return _missing_option(error, wrong)
    if isinstance(error, InterpolationResolutionError | UnsupportedInterpolationType):
        return _unresolved(error)
    if named := SAME_NAME.search(str(error)):
        return UserError(_shadowed(*named.groups()))
    match, root = KEY.search(str(error)), getattr(error.__cause__, "parent_node", None)
    for frame, _ in walk_tb(error.__traceback__):  # a deletion has no cause, but Hydra's variable
        root = frame.f_locals.get("cfg") if root is None else root
    if match and root is not None and not str(error.__cause__).startswith("Value "):
        root = root._get_root()
        values: Any = OmegaConf.to_container(root, resolve=False)
        if match[1] not in _names(values):  # else it is null
            return unknown_key(match[1], root)
    return UserError(_one_line(error))


def _missing_option(error: MissingConfigException, wrong: str) -> UserError:
    """Explain that a group has no such option, ``GROUP/OPTION``, with near matches."""
    group, _, option = wrong.rpartition("/")
    options = {each for each in error.options or () if each != "base"}
    if not group.startswith("hydra/"):  # an experiment has a folder in its name
        group, _, option = wrong.partition("/")
        options |= {*config_groups().get(group, ())}
    if name := RENAMED.get((group, option)):
        return UserError(f"{group}={option} does not exist: it is called {group}={name} now.")
    if group in ("hydra/launcher", "hydra/sweeper") and option in EXTRAS:
        return UserError(
            f"{group}={option} needs a plug-in that is not installed; run: "
            f"pip install 'tex_lightning[{EXTRAS[option]}]'"
        )
    homes = [f"{name}={option}" for name, known in config_groups().items() if option in known]
    meant = f" (did you mean {homes[0]}?)" if len(homes) == 1 else nearest(option, options)
    return UserError(
        f"{group}={shorten(option)} does not exist{meant}; "
        f"choose one of {', '.join(sorted(options))}."
    )


def _shadowed(group: str, option: str) -> str:
    """Return the sentence for a file of a user that has the name of one of the package."""
    return (
        f"{group}/{option}.yaml of yours has the name of an option of this package, which is read "
        "in its place; give it another name, and choose it by that."
    )


def check_choices(choices: Mapping[str, object], overrides: Sequence[str]) -> None:
    """Reject a chosen option that a user's folder has, too, and otherwise: the package's is read.

    Args:
        choices: An option, or a list of options, of each group.
        overrides: Those that name further folders.

    Raises:
        UserError: If there is one.
    """
    folders = [*user_folders(), *named_folders(overrides)]
    chosen = ((key, x) for key, x in choices.items() for x in (x if isinstance(x, list) else [x]))
    for key, option in chosen:
        group, file = key.partition("@")[0], f"{key.partition('@')[0]}/{option}.yaml"
        own = [folder / file for folder in folders if (folder / file).is_file()]
        read = (CONF / file).read_bytes() if own and (CONF / file).is_file() else None
        if read is not None and any(each.read_bytes() != read for each in own):
            raise UserError(_shadowed(group, str(option)))


def _unresolved(error: OmegaConfBaseException) -> UserError:
    """Return the error for a value ``${…}`` that leads nowhere."""
    said, root = str(error).splitlines()[0], error.parent_node
    wrong = re.fullmatch("Interpolation key '(.*)' not found", said)
    near = _near_keys(wrong[1], root._get_root()) if wrong and root is not None else []
    meant = f" (did you mean {' or '.join(near)}?)" if near else ""
    key = error.full_key or "A value"
    return UserError(f"{key} cannot be used: {reason(said)}{meant}; correct what stands in ${{…}}.")


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
    for pattern, words in WORDS.items():
        line = re.sub(pattern, words, line)
    return line


def _one_line(error: Exception) -> str:
    """Return the messages of an error and its cause as one line that ends in a full stop."""
    lines = [line for part in (error, error.__cause__) if part for line in str(part).splitlines()]
    kept = [line.strip().rstrip(".") for line in lines if not line.strip().startswith(NOISE)]
    kept = [re.sub("^Error merging override (.*)", r"\1 cannot be used", line) for line in kept]
    kept = [refusal(line) for line in kept]
    return "; ".join(dict.fromkeys(map(shorten, filter(None, kept)))) + "."
