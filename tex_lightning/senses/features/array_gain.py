"""Another gain of an array of pressures, told by its pattern and taken back."""

import logging

import torch
from torch import Tensor

from tex_lightning.core.console import log_once
from tex_lightning.core.devices import is_at_hand
from tex_lightning.networks.blocks import FittedLater

ARRAY = 4  # channels, of which fewer are axes
LEAST = 20  # recordings; fewer do not tell how strength and pattern go together
RIDGE = 0.01  # of the mean squared length of a pattern
SURE = 0.15  # deviation of the logarithm of the strength that is told, in training
OTHER = 0.1  # of that logarithm, as of a gain of 1.1, from which on it may be a gain
BEYOND = 4.0  # deviations in training, from which on it is one

log = logging.getLogger(__name__)


class ArrayGain(FittedLater):
    """Brings an array of pressures to the gain of the training.

    Pressed harder, an array is touched at other places too, so that its pattern, the means of the
    channels relative to each other, tells how hard it is pressed. Another gain leaves the pattern.
    Where the pattern tells the strength in training (by a ridge regression, each recording left
    out in turn), a recording that is far stronger or weaker than its pattern was made at another
    gain. Where its halves differ in that, or its pattern lies outside of the training, it is left.

    Args:
        channels: Number of channels.

    Attributes:
        weights: Product with the logarithms of the means is the logarithm of the gain (channels,).
        offset: What is added to it ().
        limit: From which on it is a gain ().
        usual: Mean pattern of the training (channels,).
        longest: Largest squared distance () of a training recording to it.
    """

    weights: Tensor
    offset: Tensor
    limit: Tensor
    usual: Tensor
    longest: Tensor

    def __init__(self, channels: int) -> None:
        super().__init__(weights=(channels,), offset=(), limit=(), usual=(channels,), longest=())

    def fit(self, means: Tensor, positive: Tensor) -> None:
        """Take what tells the gain, if anything does.

        Args:
            means: Mean of each channel of the training recordings (recordings, channels).
            positive: Which channels (channels,) are always positive.
        """
        self.take(None)
        count, channels = means.shape
        if count < LEAST or channels < ARRAY or not positive.all():
            return
        logs = means.cpu().double().log()  # some devices have no float64
        strength, pattern = _parts(logs)
        usual, middle = pattern.mean(dim=0), strength.mean()
        rows = pattern - usual
        squares = rows.square().sum(dim=1)
        scatter = rows.T @ rows
        scatter.diagonal().add_(RIDGE * squares.mean() + torch.finfo(rows.dtype).tiny)
        solved = torch.linalg.solve(scatter, rows.T)
        told = solved @ (strength - middle)  # sums to 0, as patterns do
        leverage = (rows * solved.T).sum(dim=1)
        left = (strength - middle - rows @ told) / (1 - leverage)  # by the other recordings
        if left.std() > SURE:
            return
        self.take({
            "weights": torch.full_like(told, 1 / channels) - (told - told.mean()),
            "offset": usual @ told - middle,
            "limit": (BEYOND * left.std()).clamp_min(OTHER),
            "usual": usual,
            "longest": squares.max(),
        })  # fmt: skip

    def forward(self, trace: Tensor) -> Tensor:
        """Return a trace (channels, samples) at the gain of the training."""
        return trace * self.gain(trace) if self.in_use else trace

    def gain(self, trace: Tensor) -> Tensor | float:
        """Return by what a trace (channels, samples) is multiplied, ()."""
        if not self.in_use:
            return 1.0
        half = trace.shape[-1] // 2
        parts = trace, trace[:, :half], trace[:, half:]
        means = torch.stack([part.mean(dim=-1) for part in parts])
        logs = means.clamp_min(torch.finfo(means.dtype).tiny).log()
        found = logs @ self.weights + self.offset
        away = (_parts(logs[0])[1] - self.usual).square().sum()
        far = (found > self.limit).all() | (found < -self.limit).all()
        factor = torch.where(far & (away <= self.longest), (-found[0]).exp(), 1.0)
        if is_at_hand(factor) and not torch.compiler.is_exporting() and factor != 1:
            log_once(
                log,
                f"The channels are {1 / float(factor):.3g} times as strong as their pattern tells: "
                "recordings at another gain are scaled to those of the training.",
                key="array",
            )
        return factor


def _parts(logs: Tensor) -> tuple[Tensor, Tensor]:
    """Return strength (...) and pattern (..., channels) of logarithms of means."""
    strength = logs.mean(dim=-1, keepdim=True)
    return strength[..., 0], logs - strength
