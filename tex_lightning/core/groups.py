"""Divide items by group, so that no group is on both sides of a division.

Folds, and every fit whose error is measured on left-out recordings, are divided here. So crops of
one photo, or strokes of one person, are never both fitted and tested on.
"""

from collections import Counter, defaultdict
from collections.abc import Hashable, Sequence

import numpy as np

PARTS = 10  # in which recordings are left out
DIGITS = 9  # to which shares are compared, so that rounding decides nothing


def divide(kinds: Sequence[Hashable], groups: Sequence[Hashable], parts: int) -> list[int]:
    """Divide rows into parts of whole groups, with every kind spread evenly over the parts.

    As scikit-learn's ``StratifiedGroupKFold``, and without chance: the groups, the largest first,
    each join the part that has least of their kinds. No part is empty unless there are fewer groups
    than parts, and the order of the rows makes no difference.

    Args:
        kinds: Kind of each row, such as its class.
        groups: Group of each row.
        parts: Number of parts.

    Returns:
        The part of each row, from 0.

    Example:
        >>> from tex_lightning.core.groups import divide
        >>> divide(["oak", "oak", "oak", "pine", "pine"], ["a", "a", "b", "c", "d"], parts=2)
        [0, 0, 1, 1, 0]
    """
    totals, held = Counter(kinds), defaultdict[Hashable, Counter[Hashable]](Counter)
    for kind, group in zip(kinds, groups, strict=True):
        held[group][kind] += 1
    column = {kind: number for number, kind in enumerate(totals)}
    shares = {
        group: [n / totals[kind] for kind, n in counts.items()] for group, counts in held.items()
    }
    load, sizes = np.zeros((parts, len(totals))), np.zeros(parts)
    part_of: dict[Hashable, int] = {}
    for group in sorted(held, key=lambda group: (-round(sum(shares[group]), DIGITS), str(group))):
        columns = [column[kind] for kind in held[group]]
        crowding = load[:, columns] @ shares[group]
        part = int(np.lexsort((sizes.round(DIGITS), crowding.round(DIGITS)))[0])
        load[part, columns] += shares[group]
        sizes[part] += sum(shares[group])
        part_of[group] = part
    return [part_of[group] for group in groups]


def leave_out(
    labels: Sequence[int], groups: Sequence[Hashable], recordings: Sequence[Hashable] | None = None
) -> list[int]:
    """Choose the part, of at most ten, in which each row is left out.

    What is left out as a whole is a group; of a class that has but one group a recording, of which
    the others are not independent; a class of one recording always stays.

    Args:
        labels: Class of each row.
        groups: Group of each row.
        recordings: Recording of each row; None takes every row for one.

    Returns:
        The part of each row, and -1 where it always stays; every class has rows outside of each
        part. Nothing is left out where every class has but one recording.

    Example:
        >>> from tex_lightning.core.groups import leave_out
        >>> leave_out([0, 0, 0, 1, 1, 2], ["a", "b", "b", "c", "c", "d"])
        [1, 0, 0, 1, 0, -1]
    """
    units = left_out_units(labels, groups, recordings)
    rows = [row for row, unit in enumerate(units) if unit is not None]
    kinds, some = [labels[row] for row in rows], [units[row] for row in rows]
    numbers = {unit: number for number, unit in enumerate(dict.fromkeys(some))}
    parts = divide(kinds, some, min(PARTS, len(numbers)))
    seen = Counter(label for label, _ in set(zip(kinds, parts, strict=True)))
    if rows and min(seen.values()) < 2:
        parts = [numbers[unit] for unit in some]
    chosen = dict(zip(rows, parts, strict=True))
    return [chosen.get(row, -1) for row in range(len(labels))]


def left_out_units(
    labels: Sequence[int], groups: Sequence[Hashable], recordings: Sequence[Hashable] | None = None
) -> list[tuple[str, Hashable] | None]:
    """Return the unit that each row is left out with, see :func:`leave_out`; None if it stays."""
    rows = list(zip(labels, groups, recordings or range(len(labels)), strict=True))
    grouped = Counter(label for label, _ in {(label, group) for label, group, _ in rows})
    recorded = Counter(label for label, _ in {(label, recording) for label, _, recording in rows})
    return [
        ("group", group) if grouped[label] > 1
        else ("recording", recording) if recorded[label] > 1
        else None
        for label, group, recording in rows
    ]  # fmt: skip
