"""What a checkpoint may name, and how it is built: a card is data.

A name is looked up before anything of its package is imported, because importing a module runs its
code. Then the class is called with plain values; nothing in them is resolved or looked up.
"""

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from tex_lightning.config.check_ranges import nearest
from tex_lightning.config.instantiation import HYDRAS, TARGET, find_class, making
from tex_lightning.config.search import ENTRY_POINTS, installed_packages
from tex_lightning.errors import UserError, listed, shorten

# A new class of conf/sense, conf/model or conf/trunk is added here.
CLASSES = frozenset(
    f"tex_lightning.{name}"
    for name in (
        "senses.photo.PhotoSense",
        "senses.signal.SignalSense",
        "features.image.ImageFeatures",
        "features.proportions.BandProportions",
        "features.spectrogram.SpectrogramFeatures",
        "networks.hapticnet.HapticNet",
        "networks.linear.LinearNet",
        "networks.visualnet.VisualNet",
        "networks.trunks.alexnet.CaffeAlexNet",
        "networks.trunks.alexnet.TorchvisionAlexNet",
        "networks.trunks.efficientnet_lite.EfficientNetLite0",
        "networks.trunks.efficientnet_lite.EfficientNetLite2",
        "networks.trunks.tcnn.TcnnTrunk",
        "networks.trunks.vgg_m.VggMTrunk",
        "baselines.acnn.RawNetwork",
        "baselines.fisher.FisherVectors",
        "baselines.mfcc_gmm.MfccMixtures",
        "baselines.mfcc_nb.MfccNaiveBayes",
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
        taken = inspect.signature(cls).parameters
        more = {key: value for key, value in offered.items() if key in taken and key not in values}
        _check_arguments(where, cls, values)
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


def _check_arguments(where: str, cls: type[Any], values: Mapping[str, object]) -> None:
    """Refuse arguments that a class does not take, or that are not of its fields' types."""
    taken = inspect.signature(cls).parameters
    if any(each.kind is each.VAR_KEYWORD for each in taken.values()):
        return
    for key in values:
        if key not in taken:
            near = nearest(str(key), taken, f"{where}.")
            raise UserError(
                f"There is no key {where}.{shorten(key)}{near}; {cls.__name__} has "
                f"{listed([*taken]) or 'none'}."
            )
    hints = get_type_hints(cls) if is_dataclass(cls) else {}
    for each in fields(cls) if is_dataclass(cls) else ():
        if each.name in values and not _is_of(values[each.name], hints[each.name]):
            wanted = getattr(each.type, "__name__", str(each.type))
            given = shorten(values[each.name])
            raise UserError(f"{where}.{each.name} is {given}; give a value of type {wanted}.")


def _is_of(value: object, hint: Any) -> bool:  # noqa: ANN401
    """Whether a plain value is of an annotated type; true of annotations that are not plain."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(_is_of(value, each) for each in inner)
    if origin is list:
        return isinstance(value, list) and all(_is_of(item, inner[0]) for item in value)
    if hint in (int, float) and isinstance(value, bool):
        return False
    if hint is float:
        return isinstance(value, int | float)
    return isinstance(value, hint) if hint in (int, str, bool, NoneType) else True


def _untrusted(where: str, target: str, package: str) -> UserError:
    return UserError(
        f"{where} names the class {shorten(target)}, and the package {shorten(package)} is not "
        f"trusted: give trusted=[{shorten(package)}] if its code may run, or install it with an "
        f"entry point in {ENTRY_POINTS}."
    )


def _package(target: str) -> str:
    return target.partition(".")[0]
