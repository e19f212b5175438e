"""Build the object that a ``_target_`` of the configuration names; no other module does."""

import importlib
import inspect
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from typing import Any

from hydra.errors import InstantiationException
from hydra.utils import instantiate
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from tex_lightning.config.check_ranges import nearest
from tex_lightning.core.contract import blame_users_code, resolve
from tex_lightning.errors import UserError, listed, shorten

TARGET = "_target_"
HYDRAS = (TARGET, "_args_", "_partial_", "_recursive_", "_convert_")  # keys that are no arguments
OWN = "tex_lightning."
INSTALL = "pip install 'tex_lightning[baselines]'"


def build(where: str, node: Mapping[str, Any], **offered: Any) -> Any:  # noqa: ANN401
    """Build the object that a node of the configuration names.

    Args:
        where: The node's key, for messages.
        node: ``_target_`` and arguments, which may be such nodes again. With ``_partial_: true``
            the target may be a function.
        offered: Further arguments, of which those are passed that the target takes and the node
            does not give.

    Raises:
        UserError: If the class does not exist, lacks a library, or refuses the arguments.
    """
    _check_named(where, node)
    # a function can stand for what is called later; a checkpoint names classes alone
    find = find_class if offered and not node.get("_partial_") else find_callable
    called = find(where, node)  # Hydra would hide what its module raises
    with making(where):
        taken = inspect.signature(called).parameters if offered else {}
        more = {key: value for key, value in offered.items() if key in taken and key not in node}
        return instantiate({"_convert_": "all", **node}, **more)


def build_derived(where: str, node: Mapping[str, Any], base: type, **offered: Any) -> Any:  # noqa: ANN401
    """Build an object whose class has to derive from ``base``.

    Raises:
        UserError: As :func:`build`, and if it does not.
    """
    made = build(where, node, **offered)
    if not isinstance(made, base):
        raise UserError(
            f"{where} names {shorten(node[TARGET])}, which does not derive from "
            f"{base.__module__}.{base.__name__}; name a class that does."
        )
    return made


def build_typed(where: str, node: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Build a dataclass that a node names; its fields' types hold for the node's values.

    A class that is no dataclass, has a constructor of its own or fields that the configuration has
    no type for, is built without that check, and so is a node with further nodes in it.

    Raises:
        UserError: As :func:`build`, and if a value is of the wrong type.
    """
    cls = find_class(where, node)
    arguments = {key: value for key, value in node.items() if key != TARGET}
    if not _is_plain(cls) or _has_nodes(arguments):
        return build(where, node)
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
    with making(where):
        return OmegaConf.to_object(OmegaConf.merge(schema, arguments))


def _is_plain(cls: type[Any]) -> bool:
    """Whether a class is a dataclass that is made of its fields."""
    with suppress(ValueError):  # of a class in C
        taken = {*inspect.signature(cls).parameters}
        return is_dataclass(cls) and taken == {each.name for each in fields(cls) if each.init}
    return False


def _has_nodes(values: object) -> bool:
    """Whether Hydra has more to do in a node's values than to pass them on."""
    if isinstance(values, Mapping):
        return any(key in HYDRAS or _has_nodes(value) for key, value in values.items())
    return isinstance(values, list | tuple) and any(map(_has_nodes, values))


def find_class(where: str, node: Mapping[str, Any]) -> type[Any]:
    """The class that a node names.

    Raises:
        UserError: If there is none, or it lacks a library.
    """
    found = find_callable(where, node)
    with making(where):
        if not isinstance(found, type):
            raise TypeError(f"{node[TARGET]} is no class")
        return found


def find_callable(where: str, node: Mapping[str, Any]) -> Callable[..., Any]:
    """The class or function that a node names.

    Raises:
        UserError: If there is none, or it lacks a library.
    """
    _check_named(where, node)
    with making(where):
        found = resolve(node[TARGET])
        if not callable(found):
            raise TypeError(f"{node[TARGET]} is no class or function")
        named: Callable[..., Any] = found
        return named


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
    with making(where):
        return made(*arguments)


@contextmanager
def making(where: str) -> Iterator[None]:
    """Name the key of a node whose class or module raises any error.

    What code of the user's raises keeps its traceback.

    Raises:
        UserError: If a class of a library refuses, or there is none of this name.
    """
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        cause = _innermost(error)
        if blame_users_code(cause, where):
            raise cause from cause.__cause__
        raise UserError(f"{where} fails: {_reason(cause)}") from error


def _innermost(error: Exception) -> Exception:
    while isinstance(error, InstantiationException) and isinstance(error.__cause__, Exception):
        error = error.__cause__
    return error


def _reason(error: Exception) -> str:
    """What an error says, in one line."""
    lines = str(error).splitlines()
    if isinstance(error, OmegaConfBaseException):  # what follows is of its own insides
        lines = lines[:1]
    said = " ".join(" ".join(lines).split()).rstrip(".")
    return f"{said or type(error).__name__}; correct its _target_ or arguments."
