"""Rows that a line is fitted to: what they are, how they are left out, and which to choose on."""

import math
from collections.abc import Hashable, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from tex_lightning.core.groups import PARTS, leave_out, left_out_units

MAX_ROWS = 600  # that settings are chosen on
LEAST_ROWS, SOME_CLASSES = 5, 60  # of a class; where fewer are left of each, so many classes

Pair = tuple[Tensor, Tensor]


class Examples(NamedTuple):
    """What a LinearNet is fitted to: the arguments of its method ``fit``."""

    inputs: Sequence[Tensor]
    labels: Tensor
    groups: Sequence[str] | None
    recordings: Sequence[int]
    pieces: Sequence[tuple[int, Tensor]] = ()
    disturbed: Sequence[Pair] = ()

    def with_pieces(self) -> "Examples | None":
        """Return the pieces and what they are of, all as inputs; None if a class has no piece."""
        whole = sorted({number for number, _ in self.pieces})
        if {*self.labels[whole].tolist()} != {*self.labels.tolist()}:
            return None
        rows = [*((number, self.inputs[number]) for number in whole), *self.pieces]
        numbers = [number for number, _ in rows]
        return Examples(
            [features for _, features in rows],
            self.labels[numbers],
            self.groups and [self.groups[number] for number in numbers],
            [self.recordings[number] for number in numbers],
            disturbed=self.disturbed,
        )


class LeftOut(NamedTuple):
    """How rows are left out.

    Attributes:
        parts: (rows,) part in which each is left out; -1 for none.
        units: (rows,) number of what it is left out with.
    """

    parts: Tensor
    units: Tensor


def training_rows(examples: Examples) -> tuple[Tensor, Tensor, LeftOut]:
    """Return a row for each recording, or for each fragment where each class has one recording.

    Returns:
        Rows (rows, D) float64, their labels, and how they are left out.
    """
    inputs, labels = examples.inputs, examples.labels
    recordings: Sequence[Hashable] = examples.recordings
    groups: Sequence[Hashable] = examples.groups or recordings
    parts = torch.tensor(leave_out(labels.tolist(), groups, recordings))
    named = left_out_units(labels.tolist(), groups, recordings)
    numbers = {unit: number for number, unit in enumerate(dict.fromkeys(named))}
    units = torch.tensor([numbers[unit] for unit in named])
    if bool((parts >= 0).any()):
        rows = torch.empty(len(inputs), inputs[0].shape[1], dtype=torch.float64)
        for row, features in zip(rows, inputs, strict=True):
            row.copy_(features[0].double().mean(dim=1))
        return rows, labels, LeftOut(parts, units)
    fragments = torch.tensor([features.shape[-1] for features in inputs])
    rows = torch.cat([features[0].T for features in inputs]).cpu().double()
    labels, units = (torch.repeat_interleave(x, fragments) for x in (labels, units))
    return rows, labels, LeftOut(torch.arange(len(rows)) % PARTS, units)


def unit_changes(disturbed: Sequence[Pair], scale: Tensor, level_features: int) -> Tensor:
    """Return by how much disturbed rows differ, each of length one: (changes, D).

    Kinds of disturbance count alike then, whether they are strong or weak. Levels, which a
    disturbance need not keep, count nothing.

    Args:
        disturbed: As of :class:`Examples`.
        scale: By which features are multiplied (D,).
        level_features: Number of the last features, which are levels.
    """
    pairs = [[x[0].double().cpu().mean(dim=1) for x in pair] for pair in disturbed]
    changes = torch.zeros(len(pairs), len(scale)).double()
    for row, (before, after) in zip(changes, pairs, strict=True):
        row.copy_((after - before) * scale)
    changes[:, len(scale) - level_features :] = 0
    lengths = changes.norm(dim=1)
    unit: Tensor = changes[lengths > 0] / lengths[lengths > 0, None]
    return unit


def chosen_rows(labels: Tensor, classes: int) -> tuple[Tensor, int]:
    """Return the numbers of at most 600 rows to choose settings on, evenly spread.

    They are drawn, each from its own part of all: every second row may be the same take of each
    recording.

    Of many classes so few rows of each would be left that nothing of it could be left out; then
    they are of every nth class, which comes second.
    """
    some, nth = torch.arange(len(labels)), 1
    if len(labels) > MAX_ROWS and LEAST_ROWS * classes > MAX_ROWS:
        nth = math.ceil(classes / SOME_CLASSES)
        some = some[labels % nth == 0]
    if len(some) > MAX_ROWS:
        seeded = torch.Generator().manual_seed(0)
        edges = torch.arange(MAX_ROWS + 1) * len(some) // MAX_ROWS
        within = torch.rand(MAX_ROWS, generator=seeded) * edges.diff()
        some = some[edges[:-1] + within.long()]
    return some, nth


def count_units(labels: Tensor, units: Tensor, classes: int) -> Tensor:
    """Return the number of different units of each class (classes,)."""
    pairs = {*zip(labels.tolist(), units.tolist(), strict=True)}
    return torch.tensor([label for label, _ in pairs]).bincount(minlength=classes)
