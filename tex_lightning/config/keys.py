"""Meaning, unit, choices and range of a key, as metadata on the field that declares it."""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, get_type_hints

from omegaconf import MISSING

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
