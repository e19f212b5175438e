"""Build the object that a ``_target_`` names, in the configuration or in a card.

The configuration is code: Hydra builds what it names (:func:`build`). A card is data: a class that
it names is looked up among those that are trusted before anything of its package is imported,
because importing a module runs its code, and is called with plain values (:func:`make`).
"""

import importlib
import inspect
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from types import NoneType
from typing import Any

from hydra.errors import InstantiationException
from hydra.utils import instantiate
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from tex_lightning.config.keys import annotations, fits, in_words, nearest, parameters
from tex_lightning.config.search import ENTRY_POINTS, installed_packages
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
        more = _accepted(called, node, offered) if offered else {}
        return instantiate({"_convert_": "all", **node}, **more)


def _accepted(
    called: Callable[..., Any], values: Mapping[str, Any], offered: Mapping[str, Any]
) -> dict[str, Any]:
    """Return those of the offered arguments that are taken and not given yet."""
    taken = inspect.signature(called).parameters
    return {name: item for name, item in offered.items() if name in taken and name not in values}


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
    _check_names(where, cls, arguments)
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


# A new class of conf/sense, conf/model or conf/trunk is added here.
CLASSES = frozenset(
    f"tex_lightning.{name}"
    for name in (
        "senses.photo.PhotoSense",
        "senses.signal.SignalSense",
        "senses.features.image.ImageFeatures",
        "senses.features.proportions.BandProportions",
        "senses.features.spectrogram.SpectrogramFeatures",
        "networks.hapticnet.HapticNet",
        "networks.linear.LinearNet",
        "networks.visualnet.VisualNet",
        "networks.trunks.alexnet.CaffeAlexNet",
        "networks.trunks.efficientnet_lite.EfficientNetLite0",
        "networks.trunks.efficientnet_lite.EfficientNetLite2",
        "networks.trunks.alexnet.TcnnTrunk",
        "networks.trunks.vgg_m.VggMTrunk",
        "baselines.acnn.RawNetwork",
        "baselines.fisher.FisherVectors",
        "baselines.mfcc.MfccMixtures",
        "baselines.mfcc.MfccNaiveBayes",
        "baselines.patterns.LocalBinaryPatterns",
        "baselines.rocket.MiniRocket",
    )
)
_TRUSTED: set[str] = set()  # packages and single classes, of the whole process


def trust(*names: str) -> None:
    """Trust packages or single classes in this process from now on; their code may run."""
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


def trusted_class(where: str, node: Mapping[str, Any]) -> type[Any]:
    """Return the class that a node of a card names.

    A trusted package cannot lend its name: the class has to be defined in it, so that a path
    through what a module imported leads nowhere.

    Args:
        where: Key of the node, for the message.
        node: A part of the card.

    Raises:
        UserError: If the class is not trusted; nothing of its package was imported.
    """
    target = str(node.get(TARGET)) if isinstance(node, Mapping) else ""
    if target in CLASSES or target in _TRUSTED:
        return find_class(where, node)
    package = _package(target)
    if package not in _TRUSTED and package not in installed_packages():  # which reads folders
        raise _untrusted(where, target, package)
    found = find_class(where, node)
    if (home := _package(found.__module__)) != package:
        raise _untrusted(where, target, home)
    return found


def make(where: str, node: Mapping[str, Any], **offered: Any) -> Any:  # noqa: ANN401
    """Make the object that a node of a card describes: its class, called with its values.

    Args:
        where: Key of the node, for messages.
        node: ``_target_`` and arguments, which may be such nodes again.
        offered: Further arguments, of which those are passed that the class takes and the node
            does not give.

    Raises:
        UserError: If the class is not trusted, or a value is none that a card may hold or that the
            class takes.
    """
    cls = trusted_class(where, node)
    values = make_value(where, {key: value for key, value in node.items() if key != TARGET})
    with making(where):
        more = _accepted(cls, values, offered)
        _check_names(where, cls, values)
        _check_types(where, cls, values)
        return cls(**values, **more)


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


def _check_names(where: str, cls: type[Any], values: Mapping[str, object]) -> None:
    """Refuse arguments that a class does not take."""
    taken = parameters(cls)
    if taken is None:
        return
    for name in values:
        if name not in taken:
            raise UserError(
                f"There is no key {where}.{shorten(name)}{nearest(str(name), taken, f'{where}.')}; "
                f"{cls.__name__} has {listed([*taken]) or 'none'}."
            )


def _check_types(where: str, cls: type[Any], values: Mapping[str, object]) -> None:
    """Refuse values that are not of the types of a dataclass."""
    for name, kind in annotations(cls).items() if is_dataclass(cls) else ():
        if name in values and not fits(values[name], kind):
            given = shorten(values[name])
            raise UserError(f"{where}.{name} is {given}; give {in_words(kind)}.")


def _untrusted(where: str, target: str, package: str) -> UserError:
    return UserError(
        f"{where} names the class {shorten(target)}, and the package {shorten(package)} is not "
        f"trusted: give trusted=[{shorten(package)}] if its code may run, or install it with an "
        f"entry point in {ENTRY_POINTS}."
    )


def _package(target: str) -> str:
    return target.partition(".")[0]
