"""Checks of a configuration beyond types: ranges, choices, and keys that need each other.

Ranges and choices of single keys stand in the schema. Everything is checked before any work, and
all complaints are made at once.
"""

from collections.abc import Iterator
from operator import attrgetter
from typing import Any

from omegaconf import MISSING, DictConfig, OmegaConf

from tex_lightning.config import READ_FILES, Config, flatten
from tex_lightning.config.check_nodes import check_nodes
from tex_lightning.config.check_ranges import beyond
from tex_lightning.config.check_sections import check_data, check_flags, check_model
from tex_lightning.config.check_tasks import AUTO, check_decision, check_task
from tex_lightning.config.instantiation import TARGET
from tex_lightning.config.keys import walk
from tex_lightning.config.mistakes import unknown_key
from tex_lightning.errors import UserError

__all__ = ["AUTO", "check_config", "check_known", "check_missing", "check_shares"]


def check_missing(composed: DictConfig) -> None:
    """Refuse a configuration with open ``???`` values, naming all of them."""
    missing = missing_keys(composed)
    if missing:
        example = " ".join(f"{key}=VALUE" for key in missing)
        raise UserError(f"No value for {', '.join(missing)}; add {example} to the command.")


def missing_keys(composed: DictConfig) -> list[str]:
    """Dotted names of open ``???`` values; what refers to them is not open itself."""
    values: Any = OmegaConf.to_container(composed, resolve=False)
    return sorted(key for key, value in flatten(values).items() if value == MISSING)


def check_known(composed: DictConfig) -> None:
    """Refuse keys that were added with ``+`` and that nothing would read."""
    for key in _unknown(composed, OmegaConf.structured(Config), ""):
        given = OmegaConf.select(composed, key)
        inner = OmegaConf.to_container(given) if OmegaConf.is_dict(given) else given
        raise unknown_key(next(iter(flatten({key: inner}))), composed)


def _may_be_own(given: DictConfig, prefix: str, key: str) -> bool:
    """Whether a key is one of Lightning's, see ``check_flags``, or of a sense of the user's own."""
    if prefix == "model.":
        return OmegaConf.is_dict(given[key]) and TARGET in given[key]
    starts = prefix == "model.fusion." and key.endswith("_checkpoint")
    recording = not prefix and given.task in READ_FILES
    return prefix == "trainer." or starts or recording


def _unknown(given: DictConfig, known: DictConfig, prefix: str) -> Iterator[str]:
    for key in map(str, given):
        if key not in known.keys():  # noqa: SIM118  (`in known` is false for open values)
            if not _may_be_own(given, prefix, key):
                yield f"{prefix}{key}"
        elif OmegaConf.get_type(known, key) is dict:
            continue  # of classes that check them themselves
        elif OmegaConf.is_dict(known._get_node(key)) and not OmegaConf.is_missing(given, key):
            yield from _unknown(given[key], known[key], f"{prefix}{key}.")


def check_config(config: Config) -> None:
    """Refuse invalid values, naming all of them in one sentence."""
    complaints = [
        *check_ranges(config),
        *check_data(config.data),
        *check_model(config.model),
        *check_decision(config),
        *check_task(config),
        *check_flags(config.trainer.flags),
    ]
    complaints += check_nodes(config)
    if complaints:
        raise UserError("; ".join(complaints) + ".")


def check_ranges(config: Config) -> Iterator[str]:
    """Values outside the range or the choices that the schema gives for their key."""
    for name, key in walk(Config):
        yield from beyond(name, attrgetter(name)(config), key)


def check_shares(config: Config, processes: int) -> None:
    """Refuse batches that ``processes`` processes cannot share evenly.

    Raises:
        UserError: Naming the batch sizes.
    """
    model = config.model
    complaints: list[str] = []
    for kind in model.trained:
        section = getattr(model, kind)
        size = section.fit.batch_size
        # the statistics of one sample at one position are no statistics
        normalised = getattr(section, "norm", None) == "batch"
        least = 2 if normalised and processes > 1 else 1
        if size % processes or size < least * processes:
            complaints.append(
                f"model.{kind}.fit.batch_size is {size}, but {processes} processes share every "
                f"batch: choose a multiple of {processes}, {least * processes} or more"
            )
    if complaints:
        raise UserError("; ".join(complaints) + ".")
