"""One sense of a live stream: a sensor's samples, resampled to the rate of the training."""

from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from tex_lightning.branches.signal import SignalBranch
from tex_lightning.data.arrays import as_trace
from tex_lightning.data.quality import Quality, Ranges, TraceMonitor
from tex_lightning.data.resampling import Resampler
from tex_lightning.errors import UserError


class LiveSignal:
    """Check, measure and resample the incoming samples.

    Args:
        branch: Branch of the sense.
        rate: Rate of the samples in Hz; None is the checkpoint's.
        ranges: Ranges of the training recordings, with which warnings compare.

    Attributes:
        rate: Rate in Hz that samples must have.
        samples: How many came.

    Raises:
        UserError: If there is no such rate, or it is too far from the checkpoint's.
    """

    def __init__(self, branch: SignalBranch, rate: float | None, ranges: Ranges) -> None:
        target = branch.decoder.sampling_rate
        self.modality, self.ranges = branch.modality, ranges
        self.rate = target if rate is None else rate
        if not self.rate > 0:
            raise UserError(f"rate is {self.rate:g}; give the sampling rate in Hz.")
        self.resampler: Resampler | None = None
        self.measures: dict[str, float] = {}  # beside the level
        if self.rate != target:
            self.resampler = Resampler(self.rate, target, branch.modality)
            self.measures["rate"] = min(self.rate, target)
        self.monitor = TraceMonitor(branch.what)
        self.axes: int | None = None  # not known yet
        self.samples = 0

    def take(self, samples: Any) -> Tensor:  # noqa: ANN401  (what NumPy can read)
        """Samples (axes, samples) float32 at the checkpoint's rate.

        Args:
            samples: (samples,) or (axes, samples), as many axes as before.

        Raises:
            UserError: If they are no such samples.
        """
        chunk = as_trace(samples, self.modality)
        axes, shape = self.axes or len(chunk), tuple(np.shape(samples))
        if shape != (axes, chunk.size // axes) and not (axes == len(shape) == 1):
            raise UserError(
                f"A chunk has the shape {shape}; give (axes, samples) with as many axes as before, "
                f"{axes}."
            )
        self.axes = axes
        self.samples += chunk.shape[1]
        self.monitor.update(chunk)  # resampling would blur what is constant or clipped
        found: npt.NDArray[Any] = chunk if self.resampler is None else self.resampler.push(chunk)
        return torch.from_numpy(found).float()

    def rest(self) -> Tensor | None:
        """The last samples, which the filter of the resampling holds back; None if there are none.

        They end the stream.
        """
        found = None if self.resampler is None else self.resampler.finish()
        return None if found is None else torch.from_numpy(found)

    def forget(self) -> None:
        """Forget the quality of the samples so far."""
        self.monitor = TraceMonitor(self.monitor.what)

    def quality(self, level: float | None) -> Quality:
        """Faults of the signal.

        Args:
            level: Level that is compared with the training; None compares none.
        """
        if not self.monitor.count:
            return Quality()
        measures = self.measures if level is None else {"level": level, **self.measures}
        return self.monitor.quality(self.ranges, **measures)
