"""Division by group: what was recorded together is never on both sides of a division.

Folds, and everything that is fitted on some recordings and measured on others, are divided here, so
that the pieces of one photo, or the strokes of one person, do not answer for each other.
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


def leave_out(labels: Sequence[int], groups: Sequence[Hashable]) -> list[int]:
    """Choose the part, of at most ten, in which each row is left out with its whole group.

    Args:
        labels: Class of each row.
        groups: Group of each row.

    Returns:
        The part of each row; every class has rows outside of each part. Empty where a class has but
        one group, which cannot be left out.
    """
    together = list(zip(labels, groups, strict=True))
    if min(Counter(label for label, _ in set(together)).values()) < 2:
        return []
    numbers = {group: number for number, group in enumerate(dict.fromkeys(groups))}
    parts = divide(labels, groups, min(PARTS, len(numbers)))
    seen = Counter(label for label, _ in set(zip(labels, parts, strict=True)))
    return parts if min(seen.values()) > 1 else [numbers[group] for group in groups]
