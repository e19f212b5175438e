"""Build the object that a ``_target_`` names, in the configuration or in a card.

The configuration is code: Hydra builds what it names (:func:`build`). A card is data: a class that
it names is looked up among those that are trusted before anything of its package is imported,
because importing a module runs its code, and is called with plain values (:func:`make`).
"""

import inspect
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import is_dataclass
from importlib import import_module
from types import NoneType
from typing import Any

from tex_lightning.config.signatures import (
    HYDRAS,
    NAMED,
    TARGET,
    converted,
    misfits,
    signature_of,
    strangers,
)
from tex_lightning.config.user_folders import ENTRY_POINTS, installed_packages
from tex_lightning.core.contract import keep_key, making, resolve
from tex_lightning.errors import UserError, listed, shorten

PACKAGE = "tex_lightning."


def build(where: str, node: Mapping[str, Any], **offered: Any) -> Any:  # noqa: ANN401
    """Build the object that a node of the configuration names.

    Args:
        where: The node's key, for messages.
        node: ``_target_`` and arguments, which may be such nodes again. With ``_partial_: true``
            the target may be a function.
        offered: Further arguments, of which those are passed that the target takes and the node
            does not give.

    Raises:
        UserError: If the class does not exist, lacks a library, or rejects the arguments.
    """
    from hydra.utils import instantiate  # a fifth of a second, which cards do without

    values, shared = _prepared(where, node, offered)
    with making(where, node[TARGET]):
        return instantiate({"_convert_": "all", **values}, **shared)


def _prepared(
    where: str, node: Mapping[str, Any], offered: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a node with checked arguments, in the nodes inside it too, and the accepted offers."""
    called = find_callable(where, node)
    arguments = {key: value for key, value in node.items() if key not in HYDRAS}
    values = {**node, **_checked(where, called, arguments)}
    shared = _accepted(called, node, offered)
    if not (node.get("_partial_") or node.get("_args_")):
        _check_complete(where, called, {**arguments, **shared})
    if node.get("_recursive_", True):
        values = {key: _inner(f"{where}.{key}", value) for key, value in values.items()}
    return values, shared


def _inner(where: str, value: object) -> object:
    """Return a value of a node with checked nodes in it, which Hydra builds with the node."""
    if isinstance(value, Mapping):
        if TARGET in value:
            return _prepared(where, value, {})[0]
        return {key: _inner(f"{where}.{key}", item) for key, item in value.items()}
    if isinstance(value, list):
        return [_inner(f"{where}.{index}", item) for index, item in enumerate(value)]
    return value


def _accepted(
    called: Callable[..., Any], values: Mapping[str, Any], offered: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the offered arguments that a class accepts and that are not set yet."""
    names = signature_of(called).parameters if offered else ()
    return {name: item for name, item in offered.items() if name in names and name not in values}


def build_derived(where: str, node: Mapping[str, Any], base: type, **offered: Any) -> Any:  # noqa: ANN401
    """Build an object whose class has to derive from ``base``.

    Raises:
        UserError: If :func:`build` fails, or the class does not derive from ``base``.
    """
    part = build(where, node, **offered)
    if not isinstance(part, base):
        raise UserError(
            f"{where} names {shorten(node[TARGET])}, which does not derive from "
            f"{base.__module__}.{base.__name__}; name a class that does."
        )
    keep_key(part, where)
    return part


def find_class(where: str, node: Mapping[str, Any]) -> type[Any]:
    """Return the class that a node names.

    Raises:
        UserError: If there is none.
    """
    named = find_callable(where, node)
    if not isinstance(named, type):
        raise UserError(f"{where} names {node[TARGET]}, which is no class; name one.")
    return named


def find_callable(where: str, node: Mapping[str, Any]) -> Callable[..., Any]:
    """Return the class or function that a node names.

    Raises:
        UserError: If there is none.
    """
    if not isinstance(node, Mapping) or TARGET not in node:
        raise UserError(
            f"{where} has no _target_; name the class there, as in package.module.Name."
        )
    named: Callable[..., Any] = resolve(where, str(node[TARGET]))
    if not callable(named):
        raise UserError(f"{where} names {node[TARGET]}, which is no class or function; name one.")
    return named


def call(where: str, factory: Any, *arguments: object) -> Any:  # noqa: ANN401
    """Call what a node with ``_partial_: true`` gave.

    Raises:
        UserError: If it was no such node, or the call fails.
    """
    if not callable(factory):
        raise UserError(f"{where} gives an object where a call is needed; add _partial_: true.")
    with making(where, getattr(getattr(factory, "func", factory), "__module__", "")):
        return factory(*arguments)


def _checked(
    where: str, called: Callable[..., Any], values: Mapping[str, Any]
) -> Mapping[str, Any]:
    """Return the values that are arguments of a callable, converted to its types.

    Those of a dataclass become what its fields are, where that changes nothing: a number in quotes
    is a number, and a number is text.

    Raises:
        UserError: If one is no argument, or of another type.
    """
    if unknown := next(strangers(where, called, values), None):
        raise UserError(f"{unknown}.")
    typed = converted(called, values) if is_dataclass(called) else values
    if complaints := [*misfits(where, called, typed)]:
        raise UserError("; ".join(complaints) + ".")
    return typed


def _check_complete(where: str, called: Callable[..., Any], given: Collection[str]) -> None:
    """Reject a node without an argument that its class has no default of.

    What a base class takes may be filled in by the class itself.

    Raises:
        UserError: If there is one.
    """
    try:
        parameters = inspect.signature(called).parameters.values()
    except ValueError:  # of a class in C
        return
    needed = [each.name for each in parameters if each.kind in NAMED and each.default is each.empty]
    if lacking := [name for name in needed if name not in given]:
        raise UserError(
            f"{where} lacks {listed(lacking)}, of which its class has no default; give "
            f"+{where}.{lacking[0]}=VALUE."
        )


# Where this package's parts are, and what they derive from: names, since importing takes seconds
PLACES = ("tex_lightning.senses.", "tex_lightning.networks.", "tex_lightning.baselines.")
BASES = {
    "tex_lightning.senses.base.Sense",
    "tex_lightning.networks.trunks.base.Trunk",
    "tex_lightning.baselines.base.Baseline",
}
MODULE = "torch.nn.modules.module.Module"
FITTED_LATER = "tex_lightning.networks.blocks.FittedLater"  # base of parts of others
_TRUSTED: set[str] = set()  # packages and single classes, of the whole process


def trust(*names: str) -> None:
    """Add packages or single classes to those that this process may import and run."""
    _TRUSTED.update(names)


def named_classes(node: object) -> Iterator[str]:
    """Return all classes that a node of the configuration names for a card, at any depth."""
    if isinstance(node, Mapping):
        if isinstance(target := node.get(TARGET), str):
            yield target
        for key, value in node.items():
            if key != "fit":  # which no card keeps
                yield from named_classes(value)
    elif isinstance(node, list | tuple):
        for item in node:
            yield from named_classes(item)


def own_part(target: str) -> type[Any] | None:
    """Return the class of this package that a card may name so, or None.

    That is a sense, trunk or baseline, a module of features, which is called on recordings and no
    part of another, or a network, which has ``features``;
    named where it is defined, and no base of others. Nothing but these packages is imported.
    """
    module, _, name = target.rpartition(".")
    if not target.startswith(PLACES) or not all(map(str.isidentifier, target.split("."))):
        return None
    try:
        cls = getattr(import_module(module), name, None)
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith(PACKAGE):  # a library is not installed
            raise
        return None
    if not isinstance(cls, type) or f"{cls.__module__}.{cls.__qualname__}" != target:
        return None
    bases = {f"{base.__module__}.{base.__qualname__}" for base in cls.__mro__[1:]}
    is_features = target.startswith(f"{PACKAGE}senses.features.") and "forward" in vars(cls)
    is_features = is_features and FITTED_LATER not in bases
    is_network = target.startswith(f"{PACKAGE}networks.") and hasattr(cls, "features")
    known = bases & BASES or (MODULE in bases and (is_features or is_network))
    return cls if known and not inspect.isabstract(cls) else None


def trusted_class(where: str, node: Mapping[str, Any]) -> type[Any]:
    """Return the class that a node of a card names.

    A trusted package cannot lend its name: the class has to be defined in it, so that a path
    through what a module imported leads nowhere.

    Raises:
        UserError: If the class is not trusted; nothing of its package was imported.
    """
    target = str(node.get(TARGET)) if isinstance(node, Mapping) else ""
    if (part := own_part(target)) is not None:
        return part
    if target in _TRUSTED:
        return find_class(where, node)
    package = target.partition(".")[0]
    if package not in _TRUSTED and package not in installed_packages():  # which reads folders
        raise _untrusted(where, target, package)
    cls = find_class(where, node)
    if (home := cls.__module__.partition(".")[0]) != package:
        raise _untrusted(where, target, home)
    return cls


def make(where: str, node: Mapping[str, Any], **offered: Any) -> Any:  # noqa: ANN401
    """Make the object that a node of a card describes: its class, called with its values.

    The arguments are those of :func:`build`.

    Raises:
        UserError: If the class is not trusted, or a value is none that a card may hold or that the
            class takes.
    """
    cls = trusted_class(where, node)
    values = make_value(where, {key: value for key, value in node.items() if key != TARGET})
    values, shared = _checked(where, cls, values), _accepted(cls, values, offered)
    if complaints := [*misfits(where.rpartition(".")[0], cls, shared)]:
        raise UserError("; ".join(complaints) + ".")
    _check_complete(where, cls, {**values, **shared})
    with making(where, node[TARGET]):
        return cls(**values, **shared)


def make_value(where: str, value: object) -> Any:  # noqa: ANN401
    """Return a plain value of a card with the nodes in it made.

    Raises:
        UserError: If it is none, or holds what Hydra would resolve.
    """
    if isinstance(value, Mapping):
        if TARGET in value:
            return make(where, value)
        if wrong := next((key for key in value if key in HYDRAS), None):
            raise UserError(
                f"{where} has the key {wrong}, which is for configurations; a checkpoint holds "
                "classes and plain values."
            )
        return {key: make_value(f"{where}.{shorten(key)}", item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [make_value(f"{where}.{index}", item) for index, item in enumerate(value)]
    if isinstance(value, str) and "${" in value:
        raise UserError(f"{where} is {shorten(value)}; a checkpoint holds values without ${{…}}.")
    if not isinstance(value, str | int | float | NoneType):
        raise UserError(f"{where} is of {type(value).__name__}, which is no plain value.")
    return value


def _untrusted(where: str, target: str, package: str) -> UserError:
    return UserError(
        f"{where} names the class {shorten(target)}, and the package {shorten(package)} is not "
        f"trusted: give trusted=[{shorten(package)}] if its code may run, or install it with an "
        f"entry point in {ENTRY_POINTS}."
    )
