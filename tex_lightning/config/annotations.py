"""Whether a plain value may be given where a class or the schema has an annotation."""

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

WORDS: dict[Any, str] = {
    NoneType: "null", bool: "true or false", int: "a whole number", float: "a number",
    str: "text", Path: "text", PathLike: "text",
}  # fmt: skip
LISTS = (list, tuple, set, Sequence, Iterable, Collection)


def parameters(called: Callable[..., Any]) -> dict[str, inspect.Parameter] | None:
    """What a class or function takes by name; None if it takes anything, or does not say."""
    try:
        found = inspect.signature(called).parameters.values()
    except (TypeError, ValueError):  # of a class that is not written in Python
        return None
    if any(each.kind is each.VAR_KEYWORD for each in found):
        return None
    return {each.name: each for each in found if each.kind is not each.POSITIONAL_ONLY}


def annotations(called: Callable[..., Any]) -> dict[str, Any]:
    """Types of what a class or function takes; none where they cannot be known."""
    try:
        return get_type_hints(called.__init__ if isinstance(called, type) else called)  # type: ignore[misc]
    except (AttributeError, NameError, TypeError):  # of names that type checkers alone import
        return {}


def fits(value: object, kind: Any) -> bool:  # noqa: ANN401
    """Whether a plain value is of a type; a type that is not plain takes all."""
    origin, inner = get_origin(kind) or kind, get_args(kind)
    if origin in (Union, UnionType):
        return any(fits(value, each) for each in inner)
    if origin is Literal:
        return value in inner
    if isinstance(value, bool) and origin in (int, float):
        return False
    if origin is float:
        return isinstance(value, int | float)
    if origin in (Path, PathLike):
        return isinstance(value, str)
    if origin in (bool, int, str, NoneType):
        return isinstance(value, origin)
    if origin in (dict, Mapping):
        return isinstance(value, dict)
    if origin in LISTS:
        every = isinstance(value, list) and all(fits(item, inner[0]) for item in value if inner)
        return every or (isinstance(value, str) and str in inner and origin is Sequence)
    return True


def in_words(kind: Any) -> str:  # noqa: ANN401
    """A type as a message asks for it."""
    origin, inner = get_origin(kind) or kind, get_args(kind)
    if origin in (Union, UnionType):
        wider = [each for each in inner if each is not int or float not in inner]
        return " or ".join(dict.fromkeys(map(in_words, wider)))
    if origin is Literal:
        return " or ".join(map(str, inner))
    return "a list" if origin in LISTS else WORDS.get(origin, "a class and its arguments")
