"""What an annotation says of a value beside its type: meaning, range, unit and choices.

A key is annotated where it is taken, in the signature of a class or a dataclass of the package:
``width: Annotated[float, "(0, 8]", "factor on every channel count"]``. A text that begins with an
interval is the range, with its unit behind; another is the meaning, with what null does where null
is allowed. Choices are a ``Literal``, as the type or, where Hydra has to know the type, behind it.
"""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from inspect import get_annotations
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    TypeVar,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from omegaconf import MISSING

from tex_lightning.errors import nearest, shorten

SEED = "[0, 4294967295]"  # which NumPy's generators take
INTERVAL = re.compile(r"([\[(][-+.\w]+, ?[-+.\w]+[\])]) ?(.*)")
T = TypeVar("T")
TEXT = object()  # in an annotation of Any: a value of any type is a name, or has some in it


@dataclass(frozen=True)
class Key:
    """The allowed values of one key, and its meaning.

    Attributes:
        meaning: One phrase; empty where the annotation has none.
        range: Interval of the numbers that are allowed, such as ``(0, 8]``; empty for any.
        unit: Unit of a number.
        choices: All values that are allowed; empty where they are not listed here.
        text: Whether a value of any type is a name or a path, or has such ones in it.
    """

    meaning: str = ""
    range: str = ""
    unit: str = ""
    choices: tuple[object, ...] = ()
    text: bool = False

    @classmethod
    def of(cls, hint: Any) -> "Key":  # noqa: ANN401
        """Read an annotation; one of an alternative counts for all."""
        said: dict[str, Any] = {}
        for item in _said(hint):
            interval = INTERVAL.fullmatch(item) if isinstance(item, str) else None
            if get_origin(item) is Literal:
                said["choices"] = get_args(item)
            elif interval is not None:
                said["range"], said["unit"] = interval.groups()
            elif isinstance(item, str):
                said["meaning"] = item
            said["text"] = said.get("text", False) or item is TEXT
        return cls(**said)

    def allows(self, value: float) -> bool:
        """Return whether a number is in range; NaN never is where there is a range."""
        if not self.range:
            return True
        low, high = map(float, self.range[1:-1].split(","))
        above = low <= value if self.range[0] == "[" else low < value
        return above and (value <= high if self.range[-1] == "]" else value < high)


def _said(hint: Any) -> Iterator[Any]:  # noqa: ANN401
    """Yield what stands beside the types of an annotation, and its choices."""
    kind, inner = get_origin(hint), get_args(hint)
    if kind is Literal:
        yield hint
    elif kind is Annotated:
        yield from _said(inner[0])
        yield from inner[1:]
    else:
        for item in inner:
            yield from _said(item)


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


@dataclass_transform(kw_only_default=True)
def section(cls: type[T]) -> type[T]:
    """Make a section of the schema, a dataclass whose fields a configuration file or a user fills.

    Hydra composes its fields: those without a default are open (``???``), those of names and values
    are empty, and sections are made.
    """
    for name, hint in get_annotations(cls).items():
        kind, named = without_extras(hint), vars(cls)
        if get_origin(kind) is ClassVar or name in named:
            continue
        made: Any = kind if is_dataclass(kind) else dict if get_origin(kind) is dict else None
        setattr(cls, name, MISSING if made is None else field(default_factory=made))
    return dataclass(cls)


def without_extras(hint: Any) -> Any:  # noqa: ANN401
    """Return the type of an annotation."""
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def hints_of(section: type[Any]) -> dict[str, Any]:
    """Return the annotation of each field of a dataclass."""
    hints = get_type_hints(section, include_extras=True)
    return {part.name: hints[part.name] for part in fields(section)}


def choice(name: str, value: object, allowed: Sequence[object]) -> Iterator[str]:
    """Yield an error for a value outside ``allowed``, with the nearest allowed one."""
    if value not in allowed:
        known = list(map(str, allowed))
        rest = f"choose {', '.join(known)}" if known else "there is none to choose, leave it out"
        yield f"{name} is {shorten(value)}{nearest(str(value), known)}: {rest}"
