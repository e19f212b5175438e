"""Find the rests and knocks of a tool in a signal that goes on."""

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from tex_lightning.data.decode import Array
from tex_lightning.senses.features.movement import (
    block_length,
    block_power,
    of_samples,
    power_limits,
    reach,
    rests_and_knocks,
    run_length,
)


class MarkedSignal(NamedTuple):
    """A stretch of a signal (axes, samples), and a mask (samples,) of its rests and knocks."""

    signal: Tensor
    left_out: Tensor

    @property
    def movement(self) -> Tensor:
        """The samples (axes, samples) that are neither."""
        return self.signal[:, ~self.left_out] if bool(self.left_out.any()) else self.signal


class LiveRests:
    """Find rests and knocks (:func:`~.movement.left_out`) in a signal that goes on.

    Args:
        sampling_rate: Sampling rate in Hz.
        skip: Whether to look for them; else everything is movement.
    """

    def __init__(self, sampling_rate: float, skip: bool) -> None:
        self.length = block_length(sampling_rate) if skip else None
        self.run = 0 if self.length is None else run_length(sampling_rate, self.length)
        self.horizon = self.run + reach(self.run)  # blocks that may still change what one is
        self.powers: Array = np.zeros(0, np.float32)  # of all blocks, in order of size
        self.before: Array = np.zeros(0, np.float32)  # of the last settled ones
        self.limits = 0.0, math.inf, math.inf  # of the power of a rest, a bump and a knock, by now
        self.pending: Tensor | None = None

    def push(self, new: Tensor, ahead: Tensor) -> tuple[MarkedSignal, MarkedSignal]:
        """Return the stretch whose mask is final now, and the preliminary one after it.

        Args:
            new: New samples (axes, samples).
            ahead: Preliminary samples after them; the next call replaces them.
        """
        pending = new if self.pending is None else torch.cat((self.pending, new), dim=1)
        now = torch.cat((pending, ahead), dim=1)
        out = torch.zeros(now.shape[1], dtype=torch.bool, device=now.device)
        settled = pending.shape[1]
        if self.length is not None:
            blocks = max(0, settled // self.length - self.horizon)
            settled = blocks * self.length
            out = self._judge(now, self.length, blocks)
        self.pending = pending[:, settled:].clone()
        first = MarkedSignal(now[:, :settled], out[:settled])
        return first, MarkedSignal(now[:, settled:], out[settled:])

    def _judge(self, now: Tensor, length: int, settled: int) -> Tensor:
        power = block_power(now, length).cpu().numpy()
        every = np.insert(self.powers, np.searchsorted(self.powers, np.sort(power)), np.sort(power))
        rest, bump, knock = (float(x) for x in power_limits(torch.from_numpy(every)))
        self.limits = rest, bump, knock
        known = torch.from_numpy(np.concatenate((self.before, power)))
        out = rests_and_knocks(known, *self.limits, self.run)[len(self.before) :].to(now.device)
        done = np.sort(power[:settled])
        self.powers = np.insert(self.powers, np.searchsorted(self.powers, done), done)
        self.before = np.concatenate((self.before, power[:settled]))[-self.horizon :]
        return of_samples(out, now.shape[1], length)

    def judged_again(self, signal: Tensor) -> Tensor:
        """Return which samples (samples,) of a stretch (axes, samples) are left out by now."""
        assert self.length is not None
        out = rests_and_knocks(block_power(signal, self.length), *self.limits, self.run)
        return of_samples(out, signal.shape[1], self.length)
