"""Meaning, unit, choices and range of a key, and whether a value keeps to them."""

import difflib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

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
    """

    meaning: str
    unit: str = ""
    choices: tuple[object, ...] = ()
    least: float | None = None
    most: float | None = None
    above: float | None = None
    below: float | None = None

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


def walk(section: Any, prefix: str = "") -> Iterator[tuple[str, Key]]:  # noqa: ANN401
    """Yield dotted names and metadata of all keys of a section of the schema, in order."""
    for each in fields(section):
        if METADATA in each.metadata:
            yield f"{prefix}{each.name}", each.metadata[METADATA]
        elif is_dataclass(each.default_factory):
            yield from walk(each.default_factory, f"{prefix}{each.name}.")


def beyond(name: str, value: object, key: Key) -> Iterator[str]:
    """Complain of a value, or of one in a list, that its key does not allow; null passes."""
    for item in value if isinstance(value, list) else [value]:
        if item is not None and key.choices:
            yield from choice(name, item, key.choices)
        elif isinstance(item, int | float) and not key.allows(item):
            yield f"{name} is {shorten(plain(item))}: choose {key.range}"


def choice(name: str, value: object, allowed: Sequence[object]) -> Iterator[str]:
    """Complain of a value outside ``allowed``, with the nearest one that is in it."""
    if value not in allowed:
        known = list(map(str, allowed))
        rest = f"choose {', '.join(known)}" if known else "there is none to choose, leave it out"
        yield f"{name} is {shorten(value)}{nearest(str(value), known)}: {rest}"


def nearest(given: str, known: Iterable[str], prefix: str = "") -> str:
    """Return the likeliest of the known names in brackets, with a ``prefix``; "" if none is."""
    near = difflib.get_close_matches(given, list(known), n=1)
    return f" (did you mean {prefix}{near[0]}?)" if near else ""
