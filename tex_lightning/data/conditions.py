"""Division of recordings by the conditions under which they were made."""

import math
import re
import shlex
from collections.abc import Iterable, Mapping
from typing import Any

from tex_lightning.config import Folding
from tex_lightning.config.check_ranges import nearest
from tex_lightning.data.recordings import Recording, Recordings, natural_key, plural
from tex_lightning.errors import UserError, listed

Order = tuple[bool, float, tuple[list[tuple[int, int, str]], str]]

PLAIN = re.compile(r"[\w.+-]+( [\w.+-]+)*")  # what Hydra reads without quotes


def comparable(value: object) -> float | str:
    """A value for comparison: numbers by value, so that ``60``, ``"60"`` and ``60.0`` are one.

    So are YAML's ``true`` and Python's ``True``; other words are compared as text.
    """
    text = str(value)
    if text.lower() in ("true", "false"):
        return text.lower()
    try:
        number = float(text)
    except ValueError:
        return text
    return number if math.isfinite(number) else text


def shown(value: str) -> str:
    """One text for all values that are equal in comparison."""
    known = comparable(value)
    return str(known).removesuffix(".0")


def in_order(value: str) -> Order:
    """Sort key of values: numbers by size, then words."""
    known = comparable(value)
    if isinstance(known, float):
        return False, known, natural_key("")
    return True, 0.0, natural_key(known)


def is_tested(row: Recording, where: Mapping[str, Any]) -> bool | None:
    """Whether a recording has the tested conditions; None if its sense has no such column."""
    given = {name: value for name, value in row.conditions if name in where}
    if not given:
        return None
    return all(
        comparable(value) in map(comparable, _values(where[name])) for name, value in given.items()
    )


def check_conditions(recordings: Recordings, where: Mapping[str, Any]) -> None:
    """Make sure that the recordings can be divided by ``data.test_where``.

    Args:
        recordings: The recordings of all senses in use.
        where: The tested value or values by condition.

    Raises:
        UserError: If no recording has such a condition or value, or only some of a sense have it.
    """
    for name, wanted in where.items():
        found = [(row, dict(row.conditions).get(name)) for row in recordings]
        having = {row.modality for row, value in found if value is not None}
        if not having:
            raise UserError(_no_column(recordings, name))
        absent = [row for row, value in found if value is None and row.modality in having]
        if absent:
            raise UserError(
                f"data.test_where names {name}, which {len(absent)} of the {len(found)} recordings "
                f"do not say, {absent[0].path} for one: fill it in, or leave them out."
            )
        known = {comparable(value): shown(value) for _, value in found if value is not None}
        for value in _values(wanted):
            if comparable(value) not in known:
                values = sorted(known.values(), key=in_order)
                raise UserError(
                    f"data.test_where: no recording has {name} {value}"
                    f"{nearest(str(value), values)}; choose from {listed(values)}."
                )


def _no_column(recordings: Recordings, name: str) -> str:
    senses = listed([plural(each) for each in dict.fromkeys(row.modality for row in recordings)])
    names = list(dict.fromkeys(key for row in recordings for key, _ in row.conditions))
    if not names:
        return (
            f"data.test_where names {name}, and these {senses} have no conditions; give them as "
            "further columns of a manifest (data=manifest)."
        )
    return (
        f"data.test_where names {name}, which these {senses} do not have{nearest(name, names)}; "
        f"choose from {listed(names)}."
    )


def tested_part(by: Folding) -> str:
    """Describe the tested part: some conditions, a fold, or the data."""
    if by.test_where is not None:
        return f"the part with {describe(by.test_where)}"
    return "the data" if by.test_fold is None else f"fold {by.test_fold}"


def describe(where: Mapping[str, Any]) -> str:
    """Conditions in words, as in ``speed 50 or 60 and light lamp``."""
    return " and ".join(
        f"{name} {' or '.join(map(str, _values(wanted)))}" for name, wanted in where.items()
    )


def as_override(where: Mapping[str, Any] | None) -> str:
    """The override for them in a shell."""
    if where is None:
        return "data.test_where=null"
    pairs = (f"{name}: {_typed(wanted)}" for name, wanted in where.items())
    return shlex.quote(f"data.test_where={{{', '.join(pairs)}}}")


def _typed(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_typed, value))}]"
    text = str(value)
    return text if PLAIN.fullmatch(text) else '"' + text.replace('"', '\\"') + '"'


def _values(wanted: object) -> Iterable[object]:
    return wanted if isinstance(wanted, list) else [wanted]
