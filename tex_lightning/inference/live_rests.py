"""Find the rests of a tool in a signal that goes on."""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from tex_lightning.data.decode import Array
from tex_lightning.senses.features.movement import (
    LOUD,
    REST_POWER,
    block_length,
    block_power,
    in_runs,
    run_length,
)


class MarkedSignal(NamedTuple):
    """A stretch of a signal (axes, samples), and a mask (samples,) of the rests in it."""

    signal: Tensor
    rests: Tensor

    @property
    def movement(self) -> Tensor:
        """The samples (axes, samples) that are no rest."""
        return self.signal[:, ~self.rests] if bool(self.rests.any()) else self.signal


class LiveRests:
    """Find rests of the tool (:func:`~.movement.resting`) in a signal that goes on.

    Args:
        sampling_rate: Sampling rate in Hz.
        skip: Whether to look for rests; else everything is movement.
    """

    def __init__(self, sampling_rate: float, skip: bool) -> None:
        self.length = block_length(sampling_rate) if skip else None
        self.run = 0 if self.length is None else run_length(sampling_rate, self.length)
        self.powers: Array = np.zeros(0, np.float32)  # of all blocks, in order of size
        self.before: Array = np.zeros(0, np.float32)  # of the last settled ones
        self.limit = 0.0  # power below which blocks are quiet
        self.pending: Tensor | None = None

    def push(self, new: Tensor, ahead: Tensor) -> tuple[MarkedSignal, MarkedSignal]:
        """Return the stretch whose rests are final now, and the preliminary one after it.

        Args:
            new: New samples (axes, samples).
            ahead: Preliminary samples after them; the next call replaces them.
        """
        pending = new if self.pending is None else torch.cat((self.pending, new), dim=1)
        now = torch.cat((pending, ahead), dim=1)
        rests = torch.zeros(now.shape[1], dtype=torch.bool, device=now.device)
        settled = pending.shape[1]
        if self.length is not None:
            blocks = max(0, settled // self.length - self.run)
            settled = blocks * self.length
            rests = self._judge(now, self.length, blocks)
        self.pending = pending[:, settled:].clone()
        first = MarkedSignal(now[:, :settled], rests[:settled])
        return first, MarkedSignal(now[:, settled:], rests[settled:])

    def _judge(self, now: Tensor, length: int, settled: int) -> Tensor:
        power = block_power(now, length).cpu().numpy()
        every = np.insert(self.powers, np.searchsorted(self.powers, np.sort(power)), np.sort(power))
        self.limit = REST_POWER * every[LOUD * (len(every) - 1) // 10]
        quiet = torch.from_numpy(np.concatenate((self.before, power)) < self.limit)
        rests = in_runs(quiet, self.run)[len(self.before) :].to(now.device)
        done = np.sort(power[:settled])
        self.powers = np.insert(self.powers, np.searchsorted(self.powers, done), done)
        self.before = np.concatenate((self.before, power[:settled]))[-self.run :]
        block = torch.arange(now.shape[1], device=now.device) // length
        return rests[block.clamp(max=len(power) - 1)]
