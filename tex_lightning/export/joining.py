"""Join the senses of a FusionNet in one graph, in which some may be absent."""

import math
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import pad

from tex_lightning.card import Card
from tex_lightning.export.movement import promise


class Part(NamedTuple):
    """The outputs of one sense; an absent one has no positions, and its numbers are 0.

    Attributes:
        summand: Class scores (classes, positions) that it adds to those of the others.
        alone: Those (classes, positions) by which it decides where all others are absent.
        positions: How many there are, int64 ().
        novelty: (); None where it is not known.
    """

    summand: Tensor
    alone: Tensor
    positions: Tensor
    novelty: Tensor | None

    @classmethod
    def of(cls, summand: Tensor, alone: Tensor, novelty: Tensor | None) -> "Part":
        """Make a part, with the number of its positions."""
        positions = torch.scalar_tensor(alone.shape[1], dtype=torch.int64)
        return cls(summand, alone, positions, novelty)

    def named(self, sense: str) -> dict[str, Tensor]:
        """The fields that are present, by the names of :func:`names`."""
        every = zip(names(sense), self, strict=True)
        return {name: each for name, each in every if each is not None}


def names(sense: str) -> list[str]:
    """Names of the fields of a :class:`Part` among all tensors of a graph."""
    return [f"{sense}/{field}" for field in Part._fields]


def joined(parts: list[Part], draws: Tensor) -> tuple[Tensor, Tensor]:
    """Class scores (classes, fragments), and which senses are there, bool (senses,).

    They are those of :meth:`~tex_lightning.classifier.SurfaceClassifier.part` of the senses that
    are there: sums at random tuples of positions, or of a single sense those of its positions.

    Args:
        parts: Parts of all senses, in order.
        draws: int64 (K, senses); modulo the number of positions each word is a position. The first
            column is for the first sense that is there, the next for the next.
    """
    positions = torch.stack([part.positions for part in parts])
    present = positions > 0
    columns = (present.cumsum(0) - 1).clamp(min=0)
    total, *others = (_drawn(each, draws, columns[i]) for i, each in enumerate(parts))
    for each in others:
        total = total + each
    tuples = torch.scalar_tensor(draws.shape[0], dtype=torch.int64)
    single = present.sum() == 1
    every = torch.cat((total, *(part.alone for part in parts)), dim=1)
    begin = torch.where(single, tuples, 0)
    count: int = torch.where(single, positions.sum(), tuples).item()  # type: ignore[assignment]
    promise(count >= 1)
    return every.index_select(1, begin + torch.arange(count)), present


def _drawn(part: Part, draws: Tensor, column: Tensor) -> Tensor:
    """Summands (classes, K) at random positions; zeros of an absent sense."""
    words = draws.index_select(1, column[None])[:, 0]
    places = torch.remainder(words, part.positions.clamp(min=1))
    return pad(part.summand, (0, 1)).index_select(1, places)


def is_unknown(card: Card, novelty: Tensor, present: Tensor) -> Tensor:
    """Whether the novelty () of a sample that has some senses (senses,) is too large; bool ()."""
    above = [math.inf, *thresholds(card).values()]
    which = (present * 2 ** torch.arange(len(card.senses))).sum()
    return novelty.double() > torch.tensor(above, dtype=torch.float64)[which]


def thresholds(card: Card) -> dict[str, float | None]:
    """The novelty above which a sample is unknown, by the senses it has, as ``haptic+visual``.

    They are in the order of the numbers whose bit i says that sense i is there, from 1 on.
    """
    sets = [
        [name for place, name in enumerate(card.senses) if bits >> place & 1]
        for bits in range(1, 1 << len(card.senses))
    ]
    return {"+".join(each): card.of(each).unknown_above for each in sets}
