"""Check values against the annotated signature of the class that takes them.

Checked are the types of plain values, inside lists and mappings too, and ranges: the signature
``size: Annotated[int, "[1, 64]"]`` takes whole numbers from 1 to 64. An argument that is annotated
by another class, or not at all, takes anything.
"""

import collections.abc
import inspect
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from inspect import Parameter, Signature
from types import FunctionType, NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from tex_lightning.config.keys import Key, plain, without_extras
from tex_lightning.errors import listed, nearest, shorten

TARGET = "_target_"  # of a node, which becomes something else
HYDRAS = (TARGET, "_args_", "_partial_", "_recursive_", "_convert_")  # keys that are no arguments
LISTS = (list, tuple, collections.abc.Sequence, collections.abc.Iterable)
MAPPINGS = (dict, collections.abc.Mapping, collections.abc.MutableMapping)
TRUTHS = {  # as OmegaConf reads a truth value
    **dict.fromkeys(("true", "yes", "y", "on", 1), True),
    **dict.fromkeys(("false", "no", "n", "off", 0), False),
}
EXACT = 1 << 53  # whole numbers below it are floating-point numbers, too
ANYTHING = Signature([Parameter("_", Parameter.VAR_KEYWORD)])
NAMED = (Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY)
PLAIN = (str, int, float, list, tuple, Mapping, NoneType)
NAMES: dict[Any, str] = {
    bool: "true or false", int: "a whole number", float: "a number", str: "text", NoneType: "null",
    **dict.fromkeys(LISTS, "a list"), **dict.fromkeys(MAPPINGS, "names and values"),
}  # fmt: skip


def misfits(
    where: str, called: Callable[..., Any] | Signature, values: Mapping[str, Any]
) -> Iterator[str]:
    """Yield a complaint for each value that a class or function does not take.

    Args:
        where: Key of the values, for messages.
        called: The class or function, or its signature.
        values: Arguments by name, of which those that it does not have are passed over.
    """
    parameters = signature_of(called).parameters
    for name, value in values.items():
        if name not in parameters:
            continue
        hint, default = parameters[name].annotation, parameters[name].default
        given = value is not default and repr(value) != repr(default)
        if given and (wanted := _wanted(value, hint)):
            quoted = ", in quotes of two kinds" if wanted == "text" else ""
            near = nearest(value, map(str, Key.of(hint).choices)) if isinstance(value, str) else ""
            key = f"{where}.{name}".removeprefix(".")
            yield f"{key} is {shorten(_shown(value))}{near}: give {wanted}{quoted}"


def _shown(value: object) -> str:
    return plain(value) if type(value) in (int, float) else repr(value)


def strangers(
    where: str, called: Callable[..., Any] | Signature, values: Mapping[str, Any]
) -> Iterator[str]:
    """Yield a complaint for each value that is no argument of a class or function."""
    parameters = signature_of(called).parameters
    if collects(parameters.values()):
        return
    for name in values:
        if name not in parameters:
            known = listed([*parameters]) or "none"
            key = f"{where}.{shorten(name)}"
            out = f", so leave it out, as by ~{key}"  # what another class had
            near = nearest(str(name), parameters, f"{where}.")
            yield f"There is no key {key}{near}; its class has {known}{out * (not near)}"


def converted(called: Callable[..., Any] | Signature, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values with text for numbers, and numbers for text, where arguments are such.

    Nothing is lost: where a name could be read as another number it is text before
    (:mod:`.quoting`).
    """
    parameters = signature_of(called).parameters
    return {
        name: _converted(value, parameters[name].annotation) if name in parameters else value
        for name, value in values.items()
    }


def _converted(value: Any, hint: Any) -> Any:  # noqa: ANN401
    hint = without_extras(hint)
    kinds = {hint, *map(without_extras, get_args(hint))}
    if isinstance(value, list):
        lists = [kind for kind in kinds if (get_origin(kind) or kind) in LISTS and get_args(kind)]
        return [_converted(item, get_args(lists[0])[0]) for item in value] if lists else value
    if isinstance(value, str | int) and bool in kinds and not kinds & {str, int, float, Any}:
        return TRUTHS.get(value.lower() if isinstance(value, str) else value, value)
    if isinstance(value, str):
        return value if kinds & {str, Any} else _number(value, kinds)
    if type(value) is int and float in kinds and int not in kinds:
        return float(value) if abs(value) < EXACT else value
    if isinstance(value, int | float) and str in kinds and not kinds & {bool, int, float}:
        return str(value)
    return value


def _number(text: str, kinds: set[Any]) -> int | float | str:
    """Return the number that a text is, if one of the kinds is such a number; else the text."""
    for kind in [each for each in (int, float) if each in kinds]:
        with suppress(ValueError):
            return kind(text)
    return text


def signature_of(called: Callable[..., Any] | Signature) -> Signature:
    """Return the signature of what is called with evaluated annotations, ``Any`` where it has none.

    That of a class in C takes anything; ``**kwargs`` of a constructor take what those of the
    classes take that it derives of.
    """
    if isinstance(called, Signature):
        return called
    try:
        parameters = inspect.signature(called).parameters.values()
    except ValueError:
        return ANYTHING
    function = called.__init__ if isinstance(called, type) else called  # type: ignore[misc]
    own = inherited = _annotated(function, parameters)
    for base in called.__mro__[1:] if isinstance(called, type) else ():
        make = vars(base).get("__init__")
        if isinstance(make, FunctionType) and collects(inherited):
            inherited = _annotated(make, [*inspect.signature(make).parameters.values()][1:])
            own = handing_on(own, inherited)
    return Signature(own)


def _annotated(function: Callable[..., Any], parameters: Iterable[Parameter]) -> list[Parameter]:
    try:
        hints = get_type_hints(function, include_extras=True)
    except Exception:  # of names that only a type checker knows
        hints = {}
    return [each.replace(annotation=hints.get(each.name, Any)) for each in parameters]


def collects(parameters: Iterable[Parameter]) -> bool:
    """Return whether there is a ``**kwargs`` among parameters."""
    return any(each.kind is each.VAR_KEYWORD for each in parameters)


def handing_on(own: Sequence[Parameter], base: Iterable[Parameter]) -> list[Parameter]:
    """Return parameters with those of the base class, to which ``**kwargs`` are handed on."""
    named = [each for each in own if each.kind is not each.VAR_KEYWORD]
    known = {each.name for each in named}
    more = [each for each in base if each.name not in known and each.kind in NAMED]
    rest = [each for each in own if each.kind is each.VAR_KEYWORD]
    return [*named, *(each.replace(kind=Parameter.KEYWORD_ONLY) for each in more), *rest]


def _wanted(value: Any, hint: Any) -> str:  # noqa: ANN401
    """Return what a value should have been; "" if it fits."""
    kind, inner = get_origin(hint) or hint, get_args(hint)
    is_made = not isinstance(value, PLAIN)
    if is_made or (isinstance(value, Mapping) and TARGET in value):
        return ""
    if kind is Annotated:
        return _wanted(value, inner[0]) or _outside(value, Key.of(hint), inner[0])
    if kind in (Union, UnionType):
        return _alternatives(value, inner)
    if kind is Literal:
        return "" if value in inner else f"one of {', '.join(map(str, inner))}"
    if kind in NAMES and not _fits(value, kind):
        return NAMES[kind]
    if kind in LISTS and not isinstance(value, str):
        hints = inner if kind is tuple and Ellipsis not in inner else inner[:1] * len(value)
        if inner and len(hints) != len(value):
            return f"a list of {len(hints)}"
        return _wanted_of_items("a list", value, hints)
    if kind in MAPPINGS and len(inner) == 2:
        return _wanted_of_items("names and values", value.values(), inner[1:] * len(value))
    return ""


def _wanted_of_items(what: str, items: Iterable[Any], hints: Iterable[Any]) -> str:
    """Return what all items should have been, by the first that does not fit."""
    wanted = (_wanted(item, hint) for item, hint in zip(items, hints, strict=False))
    return next((f"{what}, each {item}" for item in wanted if item), "")


def _outside(value: Any, key: Key, hint: Any) -> str:  # noqa: ANN401
    """Return what a value of the right type should have been; "" if it is allowed."""
    several = isinstance(value, list | tuple)
    items = value if several else [value]
    null = NoneType in get_args(hint) and not several
    beginning, end = "a list, each " * several, " or null" * null
    if any(isinstance(item, int | float) and not key.allows(item) for item in items):
        return f"{beginning}a number in {key.range}{key.unit and f' {key.unit}'}{end}"
    if key.choices and any(item is not None and item not in key.choices for item in items):
        return f"{beginning}one of {', '.join(map(str, key.choices))}{end}"
    return ""


def _alternatives(value: Any, hints: tuple[Any, ...]) -> str:  # noqa: ANN401
    """Return what a value should have been; "" if it fits one of several annotations.

    Beside plain values another class takes its objects alone, and a path text.
    """
    plain = [hint for hint in hints if (get_origin(hint) or hint) in {*NAMES, Annotated, Literal}]
    others = [hint for hint in hints if hint not in plain]
    if others and not [hint for hint in plain if hint is not NoneType]:
        return ""
    text = isinstance(value, str) and any(
        isinstance(each, type) and issubclass(each, os.PathLike) for each in others
    )
    if text or any(isinstance(value, each) for each in others if isinstance(each, type)):
        return ""
    missed = [_wanted(value, hint) for hint in plain]
    return " or ".join(dict.fromkeys(missed)) if all(missed) else ""


def _fits(value: Any, kind: Any) -> bool:  # noqa: ANN401
    if kind in (int, float):
        number = isinstance(value, int if kind is int else int | float)
        return number and not isinstance(value, bool) and value == value  # NaN is none
    if kind in LISTS:
        return isinstance(value, list | tuple) or (
            isinstance(value, str) and kind not in (list, tuple)
        )
    return isinstance(value, Mapping if kind in MAPPINGS else kind)
