"""Turn what Hydra says of a mistyped command line into one sentence with near matches."""

import difflib
import re
from collections.abc import Iterable

from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from tex_lightning.config import CONF
from tex_lightning.config.composition import keys_read
from tex_lightning.config.keys import nearest
from tex_lightning.errors import UserError, shorten

MISTAKES = (HydraException, OmegaConfBaseException, YAMLError)  # the last of a user's own files
KEY = re.compile(r"Could not (?:override|append to config|delete).*?'([^'=]+)")
LAUNCHERS = "hydra/launcher"
NOISE = ("full_key:", "object_type=", "reference_type=", "See https:", "Set the environment", "To ")


def explain(error: Exception) -> UserError:
    """Say what Hydra or OmegaConf raised in one sentence, with what was probably meant."""
    if isinstance(error, OverrideParseException):
        return UserError(
            f"{shorten(repr(error.override))} cannot be read; write key=value without spaces, or "
            "put quotes of two kinds around a value with spaces or signs, as in "
            "'haptic=\"my file (1).wav\"'."
        )
    group, _, option = str(getattr(error, "missing_cfg_file", "")).rpartition("/")
    if isinstance(error, MissingConfigException) and group:
        options = error.options or [file.stem for file in (CONF / group).glob("*.yaml")]
        more = ', or install what brings it (pip install ".[parallel]")' * (group == LAUNCHERS)
        return UserError(
            f"{group}={shorten(option)} does not exist{nearest(option, options)}; "
            f"choose one of {', '.join(sorted(options))}{more}."
        )
    match, root = KEY.search(str(error)), getattr(error.__cause__, "parent_node", None)
    if match and root is not None and not str(error.__cause__).startswith("Value "):
        return unknown_key(match[1], root._get_root())
    return UserError(_one_line(error))


def unknown_key(key: str, config: DictConfig) -> UserError:
    """Return the error for a key that there is not.

    Args:
        key: Its dotted name.
        config: As composed without it.
    """
    near = " or ".join(_near_keys(key, config))
    return UserError(
        f"There is no key {shorten(key)}{near and f' (did you mean {near}?)'}; "
        "`python -m tex_lightning --help=all` lists all."
    )


def _near_keys(word: str, config: DictConfig) -> list[str]:
    """Return keys that a wrong one may stand for, the likeliest rule first.

    A slip in a name beside its siblings (``model.haptic.widht``), the end of a dotted key that the
    task reads (``fit.epochs``), its name below another path, a slip in that, its initials (``lr``).
    """
    section, _, leaf = word.rpartition(".")
    node = OmegaConf.select(config, section, throw_on_missing=False) if section else config
    beside = [str(name) for name in node] if OmegaConf.is_dict(node) else []
    slips = _close(leaf, beside)
    if slips:
        return [f"{section}.{name}" if section else name for name in slips]
    names = {key: key.rpartition(".")[2] for key in keys_read(config)}
    like = _close(leaf, names.values())[:1]
    rules = (
        [key for key in names if key.endswith(f".{word}")],
        [key for key, name in names.items() if name == leaf],
        [key for key, name in names.items() if name in like],
        [key for key, name in names.items() if leaf == "".join(w[:1] for w in name.split("_"))],
    )
    return next(filter(None, rules), [])


def _close(word: str, known: Iterable[str]) -> list[str]:
    return difflib.get_close_matches(word, sorted(set(known)), n=3)


def _one_line(error: Exception) -> str:
    """Return the messages of an error and its cause as one line that ends in a full stop."""
    parts = [str(error)]
    if error.__cause__ is not None and str(error.__cause__) not in parts[0]:
        parts.append(str(error.__cause__))
    lines = [line.strip() for part in parts for line in part.splitlines()]
    kept = [line.rstrip(".") for line in lines if line and not line.startswith(NOISE)]
    return "; ".join(dict.fromkeys(map(shorten, kept))) + "."
