"""A source read in a thread of its own, so that no sensor waits for another or for a network."""

import queue
import threading
import time
from typing import Self

import numpy as np

from tex_lightning.errors import UserError
from tex_lightning.recording.parsing import Chunk
from tex_lightning.recording.sources import Pieces, Source

HELD = 100  # chunks that wait for this thread; then a pipe's writer waits, too
WAIT = 0.2  # seconds after which the thread looks whether it should stop


class Feed:
    """Chunks of one length; the thread runs inside a ``with`` block.

    Args:
        name: Name of the source, for messages.
        source: Where samples come from.
        seconds: Length of a chunk.
        timeout: Longest time without samples in seconds.

    Attributes:
        taken: Chunks that :meth:`next` has given.
    """

    def __init__(self, name: str, source: Source, seconds: float, timeout: float) -> None:
        self.name, self.source, self.timeout = name, source, timeout
        self.rate, self.size = source.rate, max(1, round(seconds * source.rate))
        self.taken = 0
        self._held: queue.Queue[Chunk | Exception | None] = queue.Queue(HELD)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._first: float | None = None  # time of the first samples, which are not counted
        self._last, self._count = 0.0, 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stopped.set()
        self._thread.join(3 * WAIT)  # one that waits for a silent pipe ends with the program

    def next(self) -> Chunk | None:
        """The next chunk (axes, samples), the last perhaps shorter; None at the end.

        Raises:
            UserError: If the source fails, or sends nothing for too long.
        """
        try:
            found = self._held.get(timeout=self.timeout + self.size / self.rate)
        except queue.Empty as error:
            raise UserError(
                f"{self.name} has sent nothing for {self.timeout:g} s; check the sensor, or give "
                "a larger record.timeout."
            ) from error
        if found is None or isinstance(found, Exception):
            self._held.put(found)  # so that it stays the end
        if isinstance(found, Exception):
            raise found
        self.taken += found is not None
        return found

    @property
    def ready(self) -> bool:
        """Whether :meth:`next` need not wait."""
        return not self._held.empty()

    @property
    def arrival_rate(self) -> float | None:
        """Samples in a second as they came, in Hz; None where that says nothing."""
        if not self.source.timed or self._first is None or not self._count:
            return None
        return self._count / (self._last - self._first)

    def _note(self, samples: int) -> None:
        self._last = time.monotonic()
        if self._first is None:
            self._first = self._last
        else:
            self._count += samples

    def _run(self) -> None:
        chunks = self.source.chunks()
        try:
            self._cut(chunks)
            self._put(None)
        except Exception as error:  # is raised in the other thread
            self._put(error)
        finally:
            chunks.close()

    def _cut(self, chunks: Pieces) -> None:
        """Put samples together to chunks of one length."""
        pieces: list[Chunk] = []
        for piece in chunks:
            if self._stopped.is_set():
                return
            if piece is None or not piece.size:
                continue
            self._note(piece.shape[1])
            pieces.append(piece)
            if sum(each.shape[1] for each in pieces) >= self.size:
                whole = np.concatenate(pieces, axis=1)
                last = whole.shape[1] - whole.shape[1] % self.size
                for start in range(0, last, self.size):
                    self._put(whole[:, start : start + self.size])
                pieces = [whole[:, last:]]
        if pieces and (rest := np.concatenate(pieces, axis=1)).size:
            self._put(rest)

    def _put(self, item: Chunk | Exception | None) -> None:
        while not self._stopped.is_set():
            try:
                return self._held.put(item, timeout=WAIT)
            except queue.Full:
                continue
