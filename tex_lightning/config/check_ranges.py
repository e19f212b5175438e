"""Complaints about single values, as parts of one sentence."""

import difflib
from collections.abc import Iterable, Iterator, Sequence

from tex_lightning.config.keys import Key, plain
from tex_lightning.errors import shorten


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
