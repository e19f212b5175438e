"""Another gain or unit of an accelerometer, told by gravity and taken back."""

import logging

import torch
from torch import Tensor
from torch.nn.functional import pad

from tex_lightning.core.console import log_once
from tex_lightning.core.devices import is_at_hand
from tex_lightning.networks.blocks import FittedLater

AXES = 3  # of an accelerometer, whose channels follow each other
LEAST = 5  # recordings; of fewer, norms may be alike by chance
ALIKE = 0.03  # deviation of the logarithms of norms that are always the same
OTHER = 1.1  # times another norm is one of another gain, and none of a movement or a tilt

log = logging.getLogger(__name__)


class GravityGain(FittedLater):
    """Brings the axes of an accelerometer to the gain of the training.

    The mean of three axes is gravity, whose norm stays however the sensor is turned. Where it is
    the same in all training recordings, one with another norm was made in another unit, such as
    g in place of m/s², or with another sensitivity. Where the norm changes between the halves of a
    recording, it is no gain that differs.

    Args:
        channels: Number of channels; each three in order may be an accelerometer.

    Attributes:
        norms: Usual norm of the mean of each three channels, 0 where it is not always the same.
    """

    norms: Tensor

    def __init__(self, channels: int) -> None:
        super().__init__(norms=(channels // AXES,))

    def fit(self, means: Tensor, positive: Tensor) -> None:
        """Take the usual norms, if there are any.

        Args:
            means: Mean of each channel of the training recordings (recordings, channels).
            positive: Which channels (channels,) are always positive, as those of pressures.
        """
        self.take(None)
        norms = _norms(means)
        if len(norms) < LEAST or not norms.shape[1]:
            return
        logs = norms.clamp_min(torch.finfo(norms.dtype).tiny).log()
        pressures = positive[: AXES * logs.shape[1]].reshape(-1, AXES).all(dim=1)
        alike = (logs.std(dim=0, correction=0) < ALIKE) & ~pressures
        if alike.any():
            self.take({"norms": torch.where(alike, norms.median(dim=0).values, 0)})

    def forward(self, trace: Tensor) -> Tensor:
        """Return a trace (channels, samples) at the gain of the training."""
        return trace * self.gain(trace) if self.in_use else trace

    def gain(self, trace: Tensor) -> Tensor | float:
        """Return by what each channel of a trace (channels, samples) is multiplied (channels, 1).

        Without gravity in the training it is 1.
        """
        if not self.in_use:
            return 1.0
        half = trace.shape[-1] // 2
        first, last = trace[:, :half].mean(dim=-1), trace[:, half:].mean(dim=-1)
        found = _norms(torch.stack((first, last)))
        norm = found.mean(dim=0)
        steady = found.amax(dim=0) < OTHER * found.amin(dim=0)
        differs = (norm > OTHER * self.norms) | (self.norms > OTHER * norm)
        factors = torch.where(steady & differs & (self.norms > 0), self.norms / norm, 1)
        if is_at_hand(factors) and not torch.compiler.is_exporting() and (factors != 1).any():
            at = int((factors != 1).nonzero()[0])
            log_once(
                log,
                f"Gravity, the mean of channels {AXES * at} to {AXES * at + 2}, is {norm[at]:.4g} "
                f"and was {self.norms[at]:.4g} in the training: recordings in another unit or at "
                "another gain are scaled to those of the training.",
                key="gravity",
            )
        factors = factors.repeat_interleave(AXES)
        return pad(factors, (0, len(first) - len(factors)), value=1.0)[:, None]


def _norms(means: Tensor) -> Tensor:
    """Return the norm of the mean of each three channels (..., channels // 3)."""
    count = means.shape[-1] // AXES
    axes = means[..., : AXES * count].reshape(*means.shape[:-1], count, AXES)
    norms: Tensor = torch.linalg.vector_norm(axes, dim=-1)
    return norms
