"""Shared parts of the readers of published data sets."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from tex_lightning.config.keys import choice
from tex_lightning.data.recordings import Recording, plural
from tex_lightning.errors import UserError, listed


@dataclass
class GroupedReader:
    """Reader of a data set whose recordings can be grouped in several ways.

    Attributes:
        root: Folder of the data set.
        group_by: What makes a group, and so a fold.
        groups: What ``group_by`` may be, and how many groups that usually makes.

    Raises:
        UserError: If ``group_by`` is unknown.
    """

    root: str
    group_by: str
    groups: Mapping[str, int]

    def __post_init__(self) -> None:
        for complaint in choice("data.group_by", self.group_by, tuple(self.groups)):
            raise UserError(f"{complaint}.")


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
                f"Folder {root} has no {plural(modality)} of {listed(missing)}; correct the name "
                f"if it is spelt differently there ({listed(other) or 'no other name'}), or leave "
                f"them out by data.reader.folders.{modality}=null."
            )
