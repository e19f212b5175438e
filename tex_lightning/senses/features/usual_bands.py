"""Bands in which a recording has nothing, as of a lower rate, and what counts in their place."""

import math
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from tex_lightning.core.devices import is_at_hand

EMPTY, LEAST_DEPTH = 4.0, 2.0  # deviations, and nepers of power: a band that far below is empty
SLOW_DEPTH = 6.0  # of slow sensors, whose quiet bands tell the material


class UsualBands(nn.Module):
    """What the bands of a window usually are in training, for recordings in which some are empty.

    What was recorded at a lower rate has nothing in the highest bands, which would count as a
    difference. Empty bands are NaN in the comparisons, and usual in the features.

    Args:
        sizes: Number of bands in each comparison.
        gap: So many bands below an empty one are at the edge of what was recorded.
        slow: Whether the signal is slow, so that levels and deviations count.
        apart: Number of axes whose bands also count one by one.

    Attributes:
        moments: Mean and deviation of each comparison of all axes together (2, channels); zeros
            where none was learnt, and then no band is empty.
        depth: How far below its usual place a band is empty, in nepers (bands,).
        least: Of the highest band over the mean of its frame (), below which it is empty.
    """

    moments: Tensor
    depth: Tensor
    least: Tensor

    def __init__(self, sizes: Sequence[int], gap: int, *, slow: bool, apart: int) -> None:
        super().__init__()
        self.sizes, self.gap, self.slow = list(sizes), gap, slow
        bands, before = self.sizes[0], sum(self.sizes[:2])
        each = sum(self.sizes) + apart * before - 1
        # channels of the highest band, compared with itself: if any band is empty, it is
        self.highest = [before + bands - 1, *(each + bands * (1 + axis) for axis in range(apart))]
        self.register_buffer("moments", torch.zeros(2, sum(self.sizes)))
        self.register_buffer("depth", torch.zeros(bands), persistent=False)
        self.register_buffer("least", torch.zeros(()), persistent=False)
        self.known = False
        loaded: Any = self.register_load_state_dict_post_hook  # it has no annotations
        loaded(UsualBands._note)

    def _note(self, *_: object) -> None:
        self.known = bool(self.moments.any())
        usual, deviation = self.moments[:, : self.sizes[0]]
        self.depth = (EMPTY * deviation).clamp_min(SLOW_DEPTH if self.slow else LEAST_DEPTH)
        self.least = usual[-1] - usual.mean() - self.depth[-1]

    def forget(self) -> None:
        """Take no band for empty."""
        self.moments.zero_()
        self._note()

    def learn(self, responses: Tensor) -> None:
        """Learn from comparisons (frames, channels) of the training."""
        joint = responses[:, : sum(self.sizes)]
        self.moments.copy_(torch.stack([joint.mean(dim=0), joint.std(dim=0, correction=0)]))
        self._note()

    def without_empty(self, logs: Tensor, mean: Tensor) -> tuple[Tensor, Tensor]:
        """Return log bands (axes, frames, bands) with NaN for empty ones, and the frames' mean.

        Empty bands would change the mean, and with it all others, so they count there as they
        usually are beside the others.

        Args:
            logs: (axes, frames, bands).
            mean: (axes, frames, 1) of all bands.
        """
        if not self.known:
            return logs, mean
        if is_at_hand(logs) and bool((logs[..., -1:] - mean > self.least).all()):
            return logs, mean
        usual, depth = self.moments[0, : self.sizes[0]], self.depth
        offset = mean - usual.mean()  # of the frame from what is usual
        apart = logs - usual
        heard = apart - offset > -depth
        for _ in range(2):  # the mean of those that are heard is higher, and more are empty below
            heard = _from_the_highest(heard)
            count = heard.sum(dim=2, keepdim=True).clamp_min(1)
            offset = (apart * heard).sum(dim=2, keepdim=True) / count
            heard = apart - offset > -depth
        above = torch.arange(self.gap, logs.shape[2] + self.gap, device=logs.device)
        heard = _from_the_highest(heard).index_select(2, above.clamp_max(logs.shape[2] - 1))
        mean = torch.where(heard, logs, usual + offset).mean(dim=2, keepdim=True)
        return torch.where(heard, logs, torch.nan), mean

    def has_empty(self, responses: Tensor) -> bool:
        """Return whether a band is empty in comparisons (frames, channels), or may be.

        It is looked for where nothing has to wait for the answer.
        """
        if not self.known or torch.compiler.is_exporting() or not is_at_hand(responses):
            return self.known
        return any(bool(responses[:, place].isnan().any()) for place in self.highest)

    def fill(self, responses: Tensor, found: Tensor, kept: Tensor) -> tuple[Tensor, Tensor]:
        """Return ``found`` and ``kept`` with what is usual in the place of empty bands.

        Thresholds are quantiles, so that the usual proportions above them are known.

        Args:
            responses: Comparisons (frames, channels), NaN where a band is empty.
            found: What of them is above the thresholds (frames, thresholds, channels).
            kept: Those whose mean, or mean and deviation, are features (frames, some channels).
        """
        empty, count = responses.isnan(), found.shape[1]
        shares = 1 - (torch.arange(count, device=found.device) + 0.5) / count
        usual = self.moments[0, : kept.shape[1]]
        if self.slow:  # deviations are features: one frame is above the mean, the next below
            frames = torch.arange(kept.shape[0], device=kept.device)
            usual = usual + (1 - 2 * (frames % 2))[:, None] * self._deviations()
        kept = torch.where(empty[:, : kept.shape[1]], usual, kept)
        # NaN is above nothing, so that a sum suffices, which exported graphs compute faster
        return found + empty[:, None].to(found.dtype) * shares[:, None], kept

    def _deviations(self) -> Tensor:
        """Return the deviation of each comparison (channels,) within a recording.

        From one window to the next a band changes by as much as two independent ones differ.
        """
        _, step, change, _ = torch.split(self.moments[1], self.sizes)
        within = change / math.sqrt(2)
        return torch.cat((within, step, change, within))

    def of_older(self, usual: Tensor) -> Tensor:
        """Return the moments by mean and depth of relative bands (2, bands); 0 of a single one."""
        moments, (mean, depth) = torch.zeros_like(self.moments), usual
        means = torch.cat((mean, mean[self.gap :] - mean[: -self.gap]))
        moments[0, : len(means)], moments[1, : len(depth)] = means, depth / EMPTY
        return moments


def _from_the_highest(heard: Tensor) -> Tensor:
    """Return which bands are heard, or lie below one that is."""
    return heard.flip(2).cumsum(dim=2).flip(2) > 0
