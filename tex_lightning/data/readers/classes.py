"""Checks that the readers of published data sets share."""

from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

from tex_lightning.data.recordings import Recording, plural
from tex_lightning.errors import UserError, listed


def check_group_by(value: str, groups: int, folds: int) -> None:
    """Refuse more folds than there are groups: some would be empty.

    Raises:
        UserError: Saying how many there may be.
    """
    if folds > groups:
        raise UserError(
            f"data.group_by={value} makes {groups} groups, but data.folds is {folds}: give "
            f"data.folds={groups}."
        )


def check_same_classes(root: Path, rows: Iterable[Recording]) -> None:
    """Refuse senses that do not have the same classes.

    Args:
        root: The data set, for messages.
        rows: Its recordings.

    Raises:
        UserError: Naming the classes and the sense that lacks them.
    """
    found: dict[str, set[str]] = defaultdict(set)
    for row in rows:
        found[row.modality].add(row.label)
    every = set[str]().union(*found.values())
    common = every.intersection(*found.values())
    for modality, names in reversed(found.items()):
        if missing := sorted(every - names):
            other = sorted(names - common)
            raise UserError(
                f"Folder {root} has no {plural(modality)} of {listed(missing)}; is the name spelt "
                f"differently there ({', '.join(other) or 'no other name'})? Or leave them out by "
                f"data.reader.folders.{modality}=null."
            )
