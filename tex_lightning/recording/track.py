"""What is recorded of one sense."""

import numpy as np

from tex_lightning.data.quality import Ranges, TraceMonitor
from tex_lightning.data.recordings import name_one
from tex_lightning.recording.feed import Feed
from tex_lightning.recording.parsing import Chunk

FEW_VALUES = 32  # different ones of an axis: what a converter with too little gain gives
TOLERANCE = 0.1  # of a rate, as a share


class Track:
    """The signal of one sense in the recording that goes on.

    Args:
        modality: ``haptic`` or ``sound``.
        feed: Its source, which has begun.
    """

    def __init__(self, modality: str, feed: Feed) -> None:
        self.modality, self.feed, self.rate = modality, feed, feed.rate
        self.clear()

    def clear(self) -> None:
        """Begin another recording."""
        self._chunks: list[Chunk] = []
        self.count = 0

    def add(self, chunk: Chunk, most: int) -> None:
        """Take the next samples (axes, samples), up to ``most`` in all."""
        kept = chunk[:, : max(0, most - self.count)]
        self._chunks.append(kept)
        self.count += kept.shape[1]

    @property
    def seconds(self) -> float:
        """How much there is."""
        return self.count / self.rate

    def cut(self, count: int) -> None:
        """Keep the first ``count`` samples."""
        if self.count > count:
            self._chunks, self.count = [self.samples[:, :count]], count

    @property
    def samples(self) -> Chunk:
        """All samples (axes, samples), float32; there has to be a chunk."""
        return np.concatenate(self._chunks, axis=1)

    def warnings(self, ranges: Ranges) -> tuple[str, ...]:
        """What is wrong with it, one sentence each.

        Args:
            ranges: Ranges of the training of a checkpoint; empty without one.
        """
        samples, what = self.samples, name_one(self.modality)
        monitor = TraceMonitor(what)
        monitor.update(samples)
        found = list(monitor.quality(ranges, level=monitor.level).warnings)
        for axis, values in enumerate(samples, start=1):
            if 1 < len(np.unique(values)) < FEW_VALUES:
                found.append(
                    f"Axis {axis} of the {what} is too quiet: it has only "
                    f"{len(np.unique(values))} different values; raise the sensor's gain."
                )
        if self.feed.source.lost:
            self.feed.source.lost = False
            found.append(f"Samples of the {what} were lost; close other programs.")
        arrived = self.feed.arrival_rate
        if arrived is not None and abs(arrived / self.rate - 1) > TOLERANCE:
            found.append(
                f"The {what} arrives at {arrived:.0f} Hz, and record.{self.modality}.rate is "
                f"{self.rate}; correct that, or the sensor."
            )
        return tuple(found)
