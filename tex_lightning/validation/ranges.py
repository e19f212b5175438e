"""Complaints about single values, as parts of one sentence."""

import difflib
from collections.abc import Iterator, Sequence


def choice(key: str, value: str, allowed: Sequence[str]) -> Iterator[str]:
    """A value outside ``allowed``, with the nearest one that is in it."""
    if value not in allowed:
        near = difflib.get_close_matches(value, allowed, n=1)
        hint = f" (did you mean {near[0]}?)" if near else ""
        yield f"{key} is {value}{hint}: choose {', '.join(allowed)}"


def least(key: str, value: float | None, least: float) -> Iterator[str]:
    """A value below ``least``; None passes."""
    if value is not None and not value >= least:
        yield f"{key} is {value:g}: choose {least:g} or more"


def most(key: str, value: float, most: float) -> Iterator[str]:
    """A value above ``most``."""
    if value > most:
        yield f"{key} is {value}: choose {most} or less"


def within(key: str, value: float, least: float, most: float) -> Iterator[str]:
    """A value outside ``least`` to ``most``."""
    if not least <= value <= most:
        yield f"{key} is {value:g}: choose from {least:g} to {most:g}"


def positive(key: str, value: float) -> Iterator[str]:
    """A value that is no positive finite number."""
    if not 0 < value < float("inf"):
        yield f"{key} is {value:g}: choose a positive number"
