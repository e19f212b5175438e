"""Mean and variance of rows over equal fragments of them, block after block."""

import torch
from torch import Tensor
from torch.nn.functional import embedding_bag

from tex_lightning.core.devices import is_at_hand

PARTS = 16  # fragments that rows are added to at once


class Moments:
    """Mean and variance of rows over equal fragments of them, added block by block.

    Blocks are joined as Chan, Golub and LeVeque (1983) do, so that nothing large is subtracted.

    Args:
        rows: Number of all rows.
        fragments: Number of fragments, at most that of rows.

    Attributes:
        mean: (fragments, D) of the rows in each fragment.
    """

    mean: Tensor
    squares: Tensor
    counts: Tensor

    def __init__(self, rows: int, fragments: int) -> None:
        self.rows, self.fragments, self.before = rows, fragments, 0

    def add(self, block: Tensor, *, squares: bool = False) -> None:
        """Add the next rows (block, D), and their squared deviations if ``squares``."""
        if torch.compiler.is_exporting() or is_at_hand(block) or block.shape[0] == self.rows:
            self._add(block, squares)
            return
        size = max(1, PARTS * self.rows // self.fragments)
        for some in torch.split(block, size):  # with many fragments most products are 0
            self._add(some, squares)

    def _add(self, block: Tensor, squares: bool) -> None:
        rows, fragments, first = self.rows, self.fragments, self.before
        self.before += block.shape[0]
        whole = first == 0 and self.before == rows
        start = 0 if whole else first * fragments // rows
        stop = fragments if whole else (self.before - 1) * fragments // rows + 1
        every = torch.arange(start, stop + 1, device=block.device)
        bounds = ((every * rows + fragments - 1) // fragments - first).clamp_(0, block.shape[0])
        counts = bounds.diff()[:, None].to(block.dtype)
        mean, around = sums_between(bounds, block) / counts, None
        if squares:
            place = torch.arange(first, self.before, device=block.device) * fragments // rows
            around = sums_between(bounds, (block - mean[place - start]).square_())
        if whole:
            self.mean, self.counts = mean, counts
            self.squares = mean if around is None else around
        else:
            self._join(slice(start, stop), counts, mean, around)

    def _join(self, part: slice, counts: Tensor, mean: Tensor, squares: Tensor | None) -> None:
        """Join counts (parts, 1), means and squares (parts, D) with those before."""
        if part.start == 0 and not hasattr(self, "mean"):
            self.mean = mean.new_zeros(self.fragments, mean.shape[-1])
            self.squares = torch.zeros_like(self.mean) if squares is not None else self.mean
            self.counts = mean.new_zeros(self.fragments, 1)
        before, away = self.counts[part].clone(), mean - self.mean[part]
        self.counts[part] += counts
        share = counts / self.counts[part]
        self.mean[part] += away * share
        if squares is not None:
            self.squares[part] += squares + away.square() * (before * share)

    @property
    def variance(self) -> Tensor:
        """Variance (fragments, D) in each fragment, of rows that were added with squares."""
        return self.squares / self.counts


def sums_between(bounds: Tensor, rows: Tensor) -> Tensor:
    """Return the sums (segments, D) of rows (n, D) from each of the bounds to the next one."""
    places = torch.arange(rows.shape[0], device=rows.device)
    if is_at_hand(rows):  # a product, most of whose factors are 0, takes five times as long
        return embedding_bag(places, rows.contiguous(), bounds[:-1], mode="sum")
    member = (places >= bounds[:-1, None]) & (places < bounds[1:, None])
    return member.to(rows.dtype) @ rows
