"""Quote file names that Hydra would misread, and take flags from between overrides."""

import re
from collections.abc import Sequence
from dataclasses import fields
from difflib import get_close_matches
from pathlib import Path
from typing import NoReturn

from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from tex_lightning.config import CONF, READ_FILES, Config
from tex_lightning.core.files import matches
from tex_lightning.errors import UserError, reason

# whose values name files
KEYS = ("haptic", "image", "sound", "checkpoint", "data.root", "data.manifest")
OWN_SENSE = re.compile(r"\+\w+")  # a key beside those of the schema
MISSPELT = 0.75  # similarity of a key with two letters exchanged


def split_flags(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """The flags of a command line with their values, and its overrides; Hydra wants them apart.

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
    flags, left = [], list(overrides)
    for argument in arguments:
        if argument in left:
            left.remove(argument)
        else:
            flags.append(argument)
    return flags, overrides


def quote_files(arguments: Sequence[str]) -> list[str]:
    """Add ``+`` to files of a user's own senses, and quotes to what Hydra's grammar would misread.

    ``force=FILE`` is then ``+force=FILE`` for tasks that read files, unless it resembles a key.
    ``haptic=my file [1].wav`` then means that file, if there is one; so does a pattern that
    matches some. Everything else stays as it is.
    """
    parser, quoted = OverridesParser.create(), []
    reads = any(argument.removeprefix("task=") in READ_FILES for argument in arguments)
    for argument in arguments:
        if reads and _is_own_sense(argument):
            argument = f"+{argument}"
        key, _, value = argument.partition("=")
        names_files = key in KEYS or OWN_SENSE.fullmatch(key)
        if names_files and _names_files(value) and _misread(parser, argument):
            escaped = re.sub(r'(\\*)("|$)', _escaped, value)
            argument = f'{key}="{escaped}"'
        quoted.append(argument)
    return quoted


def _is_own_sense(argument: str) -> bool:
    """Whether it gives a file, and its name is no key, no group and nothing that resembles one."""
    name, equals, value = argument.partition("=")
    if not (value == "-" or _names_files(value) or Path(value).suffix[1:2].isalpha()):
        return False
    known = [*(each.name for each in fields(Config)), *(path.name for path in CONF.iterdir())]
    near = get_close_matches(name, known, n=1, cutoff=MISSPELT)
    return bool(equals) and name.isidentifier() and not near


def _escaped(match: re.Match[str]) -> str:
    """Hydra reads backslashes literally, except before a quote."""
    return 2 * match[1] + ('\\"' if match[2] else "")


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
