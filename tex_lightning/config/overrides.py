"""The overrides of a command, as settings by key."""

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from types import NoneType
from typing import Any, cast

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, Quote, QuotedString
from hydra.errors import HydraException
from omegaconf import OmegaConf

from tex_lightning.config import Config, flatten
from tex_lightning.config.model import ModelConfig
from tex_lightning.config.user_folders import config_groups
from tex_lightning.errors import UserError, nearest, shorten
from tex_lightning.text import to_json

# Settings that say where a run is kept and how it is told of, and nothing of what was run.
BOOKKEEPING = (
    "hydra.", "hydra/", "logger", "data.cache_dir", "data.reader.cache_dir", "verbose", "trusted",
)  # fmt: skip
SWEEP = "multirun.yaml"  # that Hydra leaves in the folder of a sweep
Setting = bool | int | float | str


def chosen_settings(overrides: Iterable[str], swept: Sequence[str] = ()) -> dict[str, Setting]:
    """Return what overrides set, by dotted key or by group, without bookkeeping.

    Args:
        overrides: Such as ``model=haptic`` or ``+seed=1``, as Hydra reads them.
        swept: Keys that are no bookkeeping, whatever they are.

    Returns:
        Numbers, truth values and text; a list is text, ``null`` too, and what ``~key`` takes away
        is ``removed``.

    Example:
        >>> from tex_lightning.config.overrides import chosen_settings
        >>> chosen_settings(["model=haptic", "+model.haptic.fit={epochs: 3}", "verbose=0"])
        {'model': 'haptic', 'model.haptic.fit.epochs': 3}
    """
    settings = (pair for override in parsed_overrides(overrides) for pair in _settings(override))
    return {
        key: value for key, value in settings if key in swept or not key.startswith(BOOKKEEPING)
    }


def as_key_value(key: str, value: object) -> str:
    """Return an override that gives a key of the model, or any other, a value.

    Args:
        key: As Hydra names it; ``model.`` may be left out.
        value: Plain values; text stays text, whatever is in it.

    Example:
        >>> from tex_lightning.config.overrides import as_key_value
        >>> as_key_value("haptic.width", 0.5), as_key_value("data.hold_out", ["1_0"])
        ('model.haptic.width=0.5', 'data.hold_out=["1_0"]')
    """
    sign = "+" if key.startswith("+") else ""
    first, _, rest = key.removeprefix("+").partition(".")
    model = {each.name for each in fields(ModelConfig)}
    top = {each.name for each in fields(Config)} - (model if rest else set())
    inner = first not in top | {*config_groups()} and "@" not in first and "/" not in first
    return f"{sign}{'model.' if inner else ''}{key.removeprefix('+')}={_written(key, value)}"


def _written(key: str, value: Any) -> str:  # noqa: ANN401
    """Return a plain value in Hydra's grammar."""
    value = value.tolist() if hasattr(value, "tolist") else value  # of NumPy
    if isinstance(value, Mapping):
        return f"{{{','.join(f'{name}:{_written(key, item)}' for name, item in value.items())}}}"
    if isinstance(value, str | Path):
        return QuotedString(str(value), Quote.double).with_quotes()
    if isinstance(value, Sequence | Set):
        return f"[{','.join(_written(key, item) for item in value)}]"
    if not isinstance(value, int | float | NoneType):
        raise UserError(f"{key} is {shorten(value)}; give text, numbers, or lists of them.")
    return "null" if value is None else str(value).lower()


def named_model(name: str) -> str:
    """Return the override that chooses a preset or a model by its name.

    Raises:
        UserError: If there is neither, with near matches.
    """
    groups = config_groups()
    for group in ("experiment", "model"):
        if name in groups[group]:
            return f"{group}={name}"
    known = [*groups["experiment"], *groups["model"]]
    raise UserError(
        f"There is no model {shorten(name)}{nearest(str(name), known)}; choose one of "
        f"{', '.join(sorted(known))}."
    )


def swept_keys(directory: Path) -> list[str]:
    """Return the keys that the sweep of a run folder varies, as they were given; else none."""
    hydra = hydra_settings(directory)
    if hydra.get("mode") != "MULTIRUN":
        return []
    sweeper = hydra["sweeper"]
    swept: list[str] = []
    with suppress(HydraException):  # arguments of a launcher's process may be no overrides
        parsed = parsed_overrides(given_overrides(directory))
        swept = [key_of(override) for override in parsed if override.is_sweep_override()]
    named = [key for name in ("params", "search_space") for key in sweeper.get(name) or ()]
    return list(dict.fromkeys([*swept, *named]))


def hydra_settings(directory: Path) -> dict[str, Any]:
    """Return Hydra's own settings of a run folder; empty if none are on record."""
    record = directory / ".hydra" / "hydra.yaml"
    return _parsed(record.read_text(encoding="utf-8"))["hydra"] if record.is_file() else {}


@lru_cache(maxsize=2)
def _parsed(text: str) -> dict[str, Any]:
    """Return the plain values of YAML; each logger of each network asks for the same."""
    plain: Any = OmegaConf.to_container(OmegaConf.create(text), resolve=False)
    return cast(dict[str, Any], plain)


def given_overrides(directory: Path) -> list[str]:
    """Return the overrides of the sweep that a job belongs to; Optuna leaves no record of them."""
    for folder in directory.parents[:3]:  # hydra.sweep.subdir may have some
        if (folder / SWEEP).is_file():
            whole: Any = OmegaConf.to_container(OmegaConf.load(folder / SWEEP), resolve=False)
            return [str(item) for item in whole["hydra"]["overrides"]["task"]]
    return [item for item in sys.argv[1:] if "=" in item and not item.startswith("-")]


def parsed_overrides(overrides: Iterable[str]) -> list[Override]:
    """Return overrides as Hydra reads them."""
    return OverridesParser.create().parse_overrides(list(overrides))


def key_of(override: Override) -> str:
    """Return the key or group of an override."""
    return str(override.get_key_element()).lstrip("+~")


def _settings(override: Override) -> Iterator[tuple[str, Setting]]:
    key, value = key_of(override), override.value()
    if override.is_delete():
        yield key, "removed"
    elif isinstance(value, Mapping):
        for name, item in flatten({key: dict(value)}).items():
            yield name, item if isinstance(item, Setting) else to_json(item)
    else:
        yield key, value if isinstance(value, Setting) else override.get_value_element_as_str()
