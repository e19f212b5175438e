"""When a tool touches a surface, by the level of what its sensor sends."""

from collections.abc import Sequence

import numpy as np

from tex_lightning.recording.parsing import Chunk

QUIET_SECONDS = 0.5  # at first, in which nothing touches
RISE = 3.0  # times the level of that, above which something does
SILENT_SECONDS = 0.5  # below it, after which nothing does any more


def level(chunk: Chunk) -> float:
    """Root of the mean square of all axes (axes, samples) together, each without its mean."""
    return float(np.sqrt(chunk.var(axis=1, dtype=np.float64).sum()))


class Contact:
    """Follow the level of chunk after chunk.

    Args:
        seconds: Length of a chunk.

    Attributes:
        touching: Whether the tool touches; goes on through short silences.
        silent: Chunks in a row, up to now, in which it was silent.
    """

    def __init__(self, seconds: float) -> None:
        self._learn = max(1, round(QUIET_SECONDS / seconds))
        self._patience = max(1, round(SILENT_SECONDS / seconds))
        self._quiet: list[float] = []
        self.touching, self.silent = False, 0

    @property
    def ready(self) -> bool:
        """Whether the level of quiet is known."""
        return len(self._quiet) == self._learn

    def update(self, value: float) -> None:
        """Take the level of the next chunk."""
        if not self.ready:
            self._quiet.append(value)
            return
        loud = value > RISE * median(self._quiet)
        self.silent = 0 if loud else self.silent + 1
        self.touching = loud or (self.touching and self.silent < self._patience)


def median(values: Sequence[float]) -> float:
    """The middle one."""
    return float(np.median(values))
