"""What a user has chosen: the overrides of a command as settings by key."""

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from omegaconf import OmegaConf

from tex_lightning.config import flatten
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
    settings = (pair for override in _parsed(overrides) for pair in _settings(override))
    return {
        key: value for key, value in settings if key in swept or not key.startswith(BOOKKEEPING)
    }


def swept_keys(directory: Path) -> list[str]:
    """Return the keys that a sweep varies, in the order in which they were given.

    Args:
        directory: Run folder of one of its jobs; that of a single run has none.
    """
    record = directory / ".hydra" / "hydra.yaml"
    if not record.is_file():
        return []
    hydra: Any = OmegaConf.to_container(OmegaConf.load(record), resolve=False)
    if hydra["hydra"].get("mode") != "MULTIRUN":
        return []
    sweeper = hydra["hydra"]["sweeper"]
    swept: list[str] = []
    with suppress(HydraException):  # arguments of a launcher's process may be no overrides
        parsed = _parsed(_given(directory))
        swept = [_key(override) for override in parsed if override.is_sweep_override()]
    named = [key for name in ("params", "search_space") for key in sweeper.get(name) or ()]
    return list(dict.fromkeys([*swept, *named]))


def _given(directory: Path) -> list[str]:
    """Return the overrides of the sweep that a job belongs to; Optuna leaves no record of them."""
    for folder in directory.parents[:3]:  # hydra.sweep.subdir may have some
        if (folder / SWEEP).is_file():
            whole: Any = OmegaConf.to_container(OmegaConf.load(folder / SWEEP), resolve=False)
            return [str(item) for item in whole["hydra"]["overrides"]["task"]]
    return [item for item in sys.argv[1:] if "=" in item and not item.startswith("-")]


def _parsed(overrides: Iterable[str]) -> list[Override]:
    return OverridesParser.create().parse_overrides(list(overrides))


def _key(override: Override) -> str:
    return str(override.get_key_element()).lstrip("+~")


def _settings(override: Override) -> Iterator[tuple[str, Setting]]:
    key, value = _key(override), override.value()
    if override.is_delete():
        yield key, "removed"
    elif isinstance(value, Mapping):
        for name, item in flatten({key: dict(value)}).items():
            yield name, item if isinstance(item, Setting) else to_json(item)
    else:
        yield key, value if isinstance(value, Setting) else override.get_value_element_as_str()
