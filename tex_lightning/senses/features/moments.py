"""Mean and variance of rows over equal fragments of them, block after block."""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.functional import embedding_bag

from tex_lightning.core.devices import is_at_hand

PARTS = 16  # fragments that rows are added to at once


class Moments:
    """Mean of rows over equal fragments, and variance of some of their columns, block by block.

    Blocks are joined as Chan, Golub and LeVeque (1983) do, so that nothing large is subtracted.

    Args:
        rows: Number of all rows.
        fragments: Number of fragments, at most that of rows.

    Attributes:
        means: (fragments, D) of the rows in each fragment, of each of the matrices.
    """

    squares: Tensor
    counts: Tensor

    def __init__(self, rows: int, fragments: int) -> None:
        self.rows, self.fragments, self.before = rows, fragments, 0
        self.means: list[Tensor] = []

    def add(self, *blocks: Tensor, squares: bool = False) -> None:
        """Add the next rows (block, D) of matrices; ``squares`` adds the last's deviations."""
        first = blocks[0]
        if torch.compiler.is_exporting() or is_at_hand(first) or first.shape[0] == self.rows:
            self._add(blocks, squares)
            return
        size = max(1, PARTS * self.rows // self.fragments)
        for some in zip(*(torch.split(block, size) for block in blocks), strict=True):
            self._add(some, squares)  # with many fragments most products are 0

    def _add(self, blocks: Sequence[Tensor], squares: bool) -> None:
        rows, fragments, first, last = self.rows, self.fragments, self.before, blocks[-1]
        self.before += last.shape[0]
        whole = first == 0 and self.before == rows
        start = 0 if whole else first * fragments // rows
        stop = fragments if whole else (self.before - 1) * fragments // rows + 1
        every = torch.arange(start, stop + 1, device=last.device)
        bounds = ((every * rows + fragments - 1) // fragments - first).clamp_(0, last.shape[0])
        counts = bounds.diff()[:, None].to(last.dtype)
        means, around = [sums_between(bounds, block).div_(counts) for block in blocks], None
        if squares:
            place = torch.arange(first, self.before, device=last.device) * fragments // rows
            around = sums_between(bounds, (last - means[-1][place - start]).square_())
        if whole:
            self.means, self.counts = means, counts
            self.squares = means[-1] if around is None else around
        else:
            self._join(slice(start, stop), counts, means, around)

    def _join(
        self, part: slice, counts: Tensor, means: Sequence[Tensor], squares: Tensor | None
    ) -> None:
        """Join counts (parts, 1), means and squares (parts, D) with those before."""
        if not self.means:
            self.means = [mean.new_zeros(self.fragments, mean.shape[-1]) for mean in means]
            self.squares = torch.zeros_like(self.means[-1])
            self.counts = counts.new_zeros(self.fragments, 1)
        before = self.counts[part].clone()
        self.counts[part] += counts
        share = counts / self.counts[part]
        for mean, more in zip(self.means, means, strict=True):
            away = more - mean[part]
            mean[part] += away * share
        if squares is not None:  # of the last of them
            self.squares[part] += squares + away.square() * (before * share)

    @property
    def variance(self) -> Tensor:
        """Variance (fragments, D) in each fragment, of the last of what has squares."""
        return self.squares / self.counts


def sums_between(bounds: Tensor, rows: Tensor) -> Tensor:
    """Return the sums (segments, D) of rows (n, D) from each of the bounds to the next one."""
    places = torch.arange(rows.shape[0], device=rows.device)
    if is_at_hand(rows):  # a product, most of whose factors are 0, takes five times as long
        return embedding_bag(places, rows.contiguous(), bounds[:-1], mode="sum")
    member = (places >= bounds[:-1, None]) & (places < bounds[1:, None])
    return member.to(rows.dtype) @ rows
