"""Meaning, type, unit, choices and range of a key, and whether a value keeps to them."""

import difflib
import inspect
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from os import PathLike
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from omegaconf import MISSING

from tex_lightning.errors import shorten

METADATA = "key"
SEED = 2**32 - 1  # the largest that NumPy's generators take


@dataclass(frozen=True)
class Key:
    """The allowed values of one key, and its meaning.

    Attributes:
        meaning: One phrase, with what null does where null is allowed.
        unit: Unit of a number.
        choices: All values that are allowed; empty where they are not listed here.
        least: Smallest number allowed.
        most: Largest number allowed.
        above: Number that must be exceeded.
        below: Number that must not be reached.
        filled: Whether a list may not be empty.
    """

    meaning: str
    unit: str = ""
    choices: tuple[object, ...] = ()
    least: float | None = None
    most: float | None = None
    above: float | None = None
    below: float | None = None
    filled: bool = False

    def allows(self, value: float) -> bool:
        """Whether a number is in range; NaN never is where there is a range."""
        return (
            (self.least is None or value >= self.least)
            and (self.most is None or value <= self.most)
            and (self.above is None or value > self.above)
            and (self.below is None or value < self.below)
        )

    @property
    def range(self) -> str:
        """The range in words; empty where there is none."""
        if self.least is not None and self.most is not None:
            return f"from {plain(self.least)} to {plain(self.most)}"
        ends = {
            "{} or more": self.least,
            "more than {}": self.above,
            "at most {}": self.most,
            "less than {}": self.below,
        }
        said = [words.format(plain(end)) for words, end in ends.items() if end is not None]
        return " and ".join(said)


def plain(value: object) -> str:
    """Format a number: whole ones in full, others with six digits."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def key(
    meaning: str,
    *,
    default: Any = MISSING,  # noqa: ANN401
    factory: Any = None,  # noqa: ANN401
    **limits: Any,  # noqa: ANN401
) -> Any:  # noqa: ANN401
    """Declare a field of the schema.

    Args:
        meaning: See :class:`Key`.
        default: Its value until a configuration file gives one.
        factory: Makes a mutable default instead.
        **limits: Further attributes of :class:`Key`.
    """
    metadata = {METADATA: Key(meaning, **limits)}
    if factory is not None:
        return field(default_factory=factory, metadata=metadata)
    return field(default=default, metadata=metadata)


def walk(section: Any) -> Iterator[tuple[str, Key]]:  # noqa: ANN401
    """Dotted names and metadata of all keys of a section of the schema, in order."""
    return ((name, key) for name, key, _ in walk_types(section))


def walk_types(section: Any, prefix: str = "") -> Iterator[tuple[str, Key, Any]]:  # noqa: ANN401
    """Dotted names, metadata and types of all keys of a section of the schema, in order."""
    kinds = get_type_hints(section)
    for each in fields(section):
        if METADATA in each.metadata:
            yield f"{prefix}{each.name}", each.metadata[METADATA], kinds[each.name]
        elif is_dataclass(each.default_factory):
            yield from walk_types(each.default_factory, f"{prefix}{each.name}.")


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


def beyond(name: str, value: object, key: Key) -> Iterator[str]:
    """A value, or one in a list, that its key does not allow; null passes."""
    if key.filled and value == []:
        yield f"{name} is empty: give one value or several"
    for item in value if isinstance(value, list) else [value]:
        if item is None:
            continue
        if key.choices:
            yield from choice(name, item, key.choices)
        elif isinstance(item, int | float) and not key.allows(item):
            yield f"{name} is {shorten(plain(item))}: choose {key.range}"


def choice(name: str, value: object, allowed: Sequence[object]) -> Iterator[str]:
    """A value outside ``allowed``, with the nearest one that is in it."""
    if value not in allowed:
        known = list(map(str, allowed))
        rest = f"choose {', '.join(known)}" if known else "there is none to choose, leave it out"
        yield f"{name} is {shorten(value)}{nearest(str(value), known)}: {rest}"


def nearest(given: str, known: Iterable[str], prefix: str = "") -> str:
    """The likeliest of the known names in brackets, with a ``prefix``; empty if none is near."""
    near = difflib.get_close_matches(given, list(known), n=1)
    return f" (did you mean {prefix}{near[0]}?)" if near else ""


def least(name: str, value: float, least: float) -> Iterator[str]:
    """A value below ``least``."""
    if not value >= least:
        yield f"{name} is {plain(value)}: choose {plain(least)} or more"
