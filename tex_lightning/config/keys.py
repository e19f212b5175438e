"""Meaning, unit, choices and range of a key, and whether a value keeps to them."""

import difflib
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

from omegaconf import MISSING

from tex_lightning.errors import shorten

METADATA = "key"
SEED = "[0, 4294967295]"  # which NumPy's generators take


@dataclass(frozen=True)
class Key:
    """The allowed values of one key, and its meaning.

    Attributes:
        meaning: One phrase, with what null does where null is allowed.
        range: Interval of the numbers that are allowed, such as ``(0, 8]``; empty for any.
        unit: Unit of a number.
        choices: All values that are allowed; empty where they are not listed here.
        text: Whether a value of any type is a name or a path, or has such ones in it.
    """

    meaning: str
    range: str = ""
    unit: str = ""
    choices: tuple[object, ...] = ()
    text: bool = False

    def allows(self, value: float) -> bool:
        """Return whether a number is in range; NaN never is where there is a range."""
        if not self.range:
            return True
        low, high = map(float, self.range[1:-1].split(","))
        closed = (self.range[0] == "[" and value == low) or (
            self.range[-1] == "]" and value == high
        )
        return low < value < high or closed


def plain(value: object) -> str:
    """Format a number: whole ones in full, others with six digits."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def typed(values: Any, name: str) -> str:  # noqa: ANN401
    """Return the value of a dotted key as it is typed on the command line; "" if there is none."""
    for part in name.split("."):
        if not isinstance(values, dict) or part not in values:
            return ""
        values = values[part]
    plainly = isinstance(values, str | float)
    return plain(values) if plainly else json.dumps(values).replace('"', "")


def key(
    meaning: str,
    range: str = "",
    *,
    default: Any = MISSING,  # noqa: ANN401
    factory: Any = None,  # noqa: ANN401
    **more: Any,  # noqa: ANN401
) -> Any:  # noqa: ANN401
    """Declare a field of the schema.

    Args:
        meaning: See :class:`Key`.
        range: See there.
        default: Value of the key unless a configuration file sets one.
        factory: Makes a mutable default instead.
        **more: Further attributes of :class:`Key`.
    """
    metadata = {METADATA: Key(meaning, range, **more)}
    if factory is not None:
        return field(default_factory=factory, metadata=metadata)
    return field(default=default, metadata=metadata)


def walk(section: Any, prefix: str = "") -> Iterator[tuple[str, Key]]:  # noqa: ANN401
    """Yield dotted names and metadata of all keys of a section of the schema, in order."""
    for part in fields(section):
        if METADATA in part.metadata:
            yield f"{prefix}{part.name}", part.metadata[METADATA]
        elif is_dataclass(part.default_factory):
            yield from walk(part.default_factory, f"{prefix}{part.name}.")


def beyond(name: str, value: object, key: Key) -> Iterator[str]:
    """Yield an error for each value, or item of a list, that ``key`` does not allow."""
    for item in value if isinstance(value, list) else [value]:
        if item is not None and key.choices:
            yield from choice(name, item, key.choices)
        elif isinstance(item, int | float) and not key.allows(item):
            yield f"{name} is {shorten(plain(item))}: choose from {key.range}"


def choice(name: str, value: object, allowed: Sequence[object]) -> Iterator[str]:
    """Yield an error for a value outside ``allowed``, with the nearest allowed one."""
    if value not in allowed:
        known = list(map(str, allowed))
        rest = f"choose {', '.join(known)}" if known else "there is none to choose, leave it out"
        yield f"{name} is {shorten(value)}{nearest(str(value), known)}: {rest}"


def nearest(name: str, known: Iterable[str], prefix: str = "") -> str:
    """Return the likeliest of the known names in brackets, with a ``prefix``; "" if none is."""
    near = difflib.get_close_matches(name, list(known), n=1)
    return f" (did you mean {prefix}{near[0]}?)" if near else ""
