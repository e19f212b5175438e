"""Another gain or unit of an accelerometer, told by gravity and taken back."""

import logging

import torch
from torch import Tensor
from torch.nn.functional import pad

from tex_lightning.core.console import log_once
from tex_lightning.core.devices import is_at_hand
from tex_lightning.networks.blocks import FittedLater

AXES = 3  # of an accelerometer, whose channels follow each other
LEAST = 5  # recordings; of fewer, lengths may be alike by chance
ALIKE = 0.03  # deviation of the logarithms of lengths that are always the same
OTHER = 1.1  # times another length is one of another gain, and none of a movement or a tilt

log = logging.getLogger(__name__)


class GravityGain(FittedLater):
    """Brings the axes of an accelerometer to the gain of the training.

    The mean of three axes is gravity, whose length stays however the sensor is turned. Where it is
    the same in all training recordings, one with another length was made in another unit, such as
    g in place of m/s², or with another sensitivity. In one whose length changes between its halves,
    it is something else that changes.

    Args:
        channels: Number of channels; each three in order may be an accelerometer.

    Attributes:
        lengths: Usual length of the mean of each three channels, 0 where it is not always the same.
    """

    lengths: Tensor

    def __init__(self, channels: int) -> None:
        super().__init__(lengths=(channels // AXES,))

    def fit(self, means: Tensor, positive: Tensor) -> None:
        """Take the usual lengths, if there are any.

        Args:
            means: Mean of each channel of the training recordings (recordings, channels).
            positive: Which channels (channels,) are always positive, as those of pressures.
        """
        self.take(None)
        lengths = _lengths(means)
        if len(lengths) < LEAST or not lengths.shape[1]:
            return
        logs = lengths.clamp_min(torch.finfo(lengths.dtype).tiny).log()
        pressures = positive[: AXES * logs.shape[1]].reshape(-1, AXES).all(dim=1)
        alike = (logs.std(dim=0, correction=0) < ALIKE) & ~pressures
        if alike.any():
            self.take({"lengths": torch.where(alike, lengths.median(dim=0).values, 0)})

    def forward(self, trace: Tensor) -> Tensor:
        """Return a trace (channels, samples) at the gain of the training."""
        return trace * self.gain(trace) if self.in_use else trace

    def gain(self, trace: Tensor) -> Tensor | float:
        """Return by what each channel of a trace (channels, samples) is multiplied (channels, 1).

        Where nothing is ever, it is 1.
        """
        if not self.in_use:
            return 1.0
        half = trace.shape[-1] // 2
        first, last = trace[:, :half].mean(dim=-1), trace[:, half:].mean(dim=-1)
        found = _lengths(torch.stack((first, last)))
        length = found.mean(dim=0)
        steady = found.amax(dim=0) < OTHER * found.amin(dim=0)
        differs = (length > OTHER * self.lengths) | (self.lengths > OTHER * length)
        factors = torch.where(steady & differs & (self.lengths > 0), self.lengths / length, 1)
        if is_at_hand(factors) and not torch.compiler.is_exporting() and (factors != 1).any():
            axes = int((factors != 1).nonzero()[0])
            log_once(
                log,
                f"The mean of channels {AXES * axes} to {AXES * axes + 2} is {length[axes]:.4g} "
                f"long, and {self.lengths[axes]:.4g} in the training, as gravity in another unit "
                "or at another gain: such recordings are brought to that of the training.",
                key="gravity",
            )
        factors = factors.repeat_interleave(AXES)
        return pad(factors, (0, len(first) - len(factors)), value=1.0)[:, None]


def _lengths(means: Tensor) -> Tensor:
    """Return the length of the mean of each three channels (..., channels // 3)."""
    count = means.shape[-1] // AXES
    axes = means[..., : AXES * count].reshape(*means.shape[:-1], count, AXES)
    lengths: Tensor = torch.linalg.vector_norm(axes, dim=-1)
    return lengths
