"""Build the object that a ``_target_`` of the configuration names; no other module does."""

import importlib
import inspect
import pkgutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from hydra.errors import InstantiationException
from hydra.utils import instantiate
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from tex_lightning.config.check_ranges import nearest
from tex_lightning.errors import UserError, listed, shorten

TARGET = "_target_"
OWN = "tex_lightning."
INSTALL = "pip install 'tex_lightning[baselines]'"


def build(where: str, node: Mapping[str, Any], **offered: Any) -> Any:  # noqa: ANN401
    """Build the object that a node of the configuration names.

    Args:
        where: The node's key, for messages.
        node: ``_target_`` and arguments, which may be such nodes again.
        offered: Further arguments, of which those are passed that the class takes and the node
            does not give.

    Raises:
        UserError: If the class does not exist, lacks a library, or refuses the arguments.
    """
    _check_named(where, node)
    with _making(where):
        taken = inspect.signature(find_class(where, node)).parameters if offered else {}
        more = {key: value for key, value in offered.items() if key in taken and key not in node}
        return instantiate({"_convert_": "all", **node}, **more)


def build_typed(where: str, node: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Build a dataclass that a node names; its fields' types hold for the node's values.

    A class that is no dataclass, or has fields that the configuration has no type for, is built
    without that check.

    Raises:
        UserError: As :func:`build`, and if a value is of the wrong type.
    """
    cls = find_class(where, node)
    arguments = {key: value for key, value in node.items() if not key.startswith("_")}
    try:
        schema = OmegaConf.structured(cls)
    except OmegaConfBaseException:
        return build(where, node)
    for key in arguments:
        if key not in (known := list(map(str, schema.keys()))):
            raise UserError(
                f"There is no key {where}.{shorten(key)}{nearest(key, known, f'{where}.')}; "
                f"{cls.__name__} has {listed(known) or 'none'}."
            )
    with _making(where):
        return OmegaConf.to_object(OmegaConf.merge(schema, arguments))


def find_class(where: str, node: Mapping[str, Any]) -> type[Any]:
    """The class that a node names.

    Raises:
        UserError: If there is none, or it lacks a library.
    """
    _check_named(where, node)
    with _making(where):
        found = pkgutil.resolve_name(node[TARGET])  # Hydra's own would log the error as well
        if not isinstance(found, type):
            raise TypeError(f"{node[TARGET]} is no class")
        return found


def _check_named(where: str, node: Mapping[str, Any]) -> None:
    if not isinstance(node, Mapping) or TARGET not in node:
        raise UserError(
            f"{where} has no _target_; name the class there, as in package.module.Name."
        )


def missing_library(node: Mapping[str, Any]) -> str | None:
    """The library that a class of this package needs and that is not installed, or None."""
    target = str(node.get(TARGET))
    if target.startswith(OWN):
        try:
            importlib.import_module(target.rpartition(".")[0])
        except ModuleNotFoundError as error:
            return error.name
    return None


def call(where: str, made: Any, *arguments: object) -> Any:  # noqa: ANN401
    """Call what a node with ``_partial_: true`` gave.

    Raises:
        UserError: If it was no such node, or the call fails.
    """
    if not callable(made):
        raise UserError(f"{where} gives an object where a call is needed; add _partial_: true.")
    with _making(where):
        return made(*arguments)


@contextmanager
def _making(where: str) -> Iterator[None]:
    """Name the key of a node whose class or module, perhaps the user's, raises any error."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        raise UserError(f"{where} cannot be made: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    """The innermost cause in one line."""
    while isinstance(error, InstantiationException) and isinstance(error.__cause__, Exception):
        error = error.__cause__
    lines = str(error).splitlines()
    if isinstance(error, OmegaConfBaseException):  # what follows is of its own insides
        lines = lines[:1]
    said = " ".join(" ".join(lines).split()).rstrip(".")
    return f"{said or type(error).__name__}; correct its _target_ or arguments."
