"""One recording of several senses at once, by time or by contact.

Every source is read in a thread of its own, so that no sensor waits for another or for a network.
All signals are cut into chunks of the same duration, which are taken side by side.
"""

import queue
import threading
import time
from collections.abc import Callable, Sequence
from typing import Self

import numpy as np

from tex_lightning.data.quality import Ranges, TraceMonitor, level
from tex_lightning.data.recordings import name_one
from tex_lightning.errors import UserError
from tex_lightning.recording.sources import Chunk, Pieces, Source

HELD = 100  # chunks that wait for this thread; then a pipe's writer waits, too
WAIT = 0.2  # seconds after which the thread looks whether it should stop
TOLERANCE = 0.1  # of a rate, as a share


class Signal:
    """The signal of one sensor; a thread reads it inside a ``with`` block.

    Args:
        modality: ``haptic`` or ``sound``.
        name: Name of the source, for messages.
        source: Where samples come from.
        seconds: Length of a chunk.
        timeout: Longest time without samples in seconds.

    Attributes:
        count: Samples of the present recording.
    """

    def __init__(
        self, modality: str, name: str, source: Source, seconds: float, timeout: float
    ) -> None:
        self.modality, self.name, self.source, self.timeout = modality, name, source, timeout
        self.rate, self.size = source.rate, max(1, round(seconds * source.rate))
        self.clear()
        self._held: queue.Queue[Chunk | Exception | None] = queue.Queue(HELD)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._times: list[float] = []  # of the first samples, which are not counted, and the last
        self._arrived = 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stopped.set()
        self._thread.join(3 * WAIT)  # one that waits for a silent pipe ends with the program

    def next(self) -> Chunk | None:
        """Return the next chunk (axes, samples), the last perhaps shorter; None at the end.

        Raises:
            UserError: If the source fails, or sends nothing for too long.
        """
        try:
            chunk = self._held.get(timeout=self.timeout + self.size / self.rate)
        except queue.Empty as error:
            raise UserError(
                f"{self.name} has sent nothing for {self.timeout:g} s; check the sensor, or give "
                "a larger record.timeout."
            ) from error
        if chunk is None or isinstance(chunk, Exception):
            self._held.put(chunk)  # so that it stays the end
        if isinstance(chunk, Exception):
            raise chunk
        return chunk

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
        """Join pieces of samples and cut them into chunks of one length."""
        pieces: list[Chunk] = []
        for piece in chunks:
            if self._stopped.is_set():
                return
            if piece is None or not piece.size:
                continue
            self._arrived += piece.shape[1] if self._times else 0
            self._times[1:] = [time.monotonic()]
            pieces.append(piece)
            if sum(piece.shape[1] for piece in pieces) >= self.size:
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

    def clear(self) -> None:
        """Begin another recording."""
        self._chunks: list[Chunk] = []
        self.count = 0

    def add(self, chunk: Chunk) -> None:
        """Append samples (axes, samples) to the recording."""
        self._chunks.append(chunk)
        self.count += chunk.shape[1]

    def cut(self, seconds: float) -> None:
        """Keep so many seconds of the recording."""
        count = round(seconds * self.rate)
        if self.count > count:
            self._chunks, self.count = [self.samples[:, :count]], count

    @property
    def seconds(self) -> float:
        """Length of the recording."""
        return self.count / self.rate

    @property
    def samples(self) -> Chunk:
        """Return all samples of the recording (axes, samples), float32; there has to be a chunk."""
        return np.concatenate(self._chunks, axis=1)

    def warnings(self, ranges: Ranges) -> tuple[str, ...]:
        """Name the faults of the recording, a sentence each.

        Args:
            ranges: Ranges of the training of a checkpoint; empty without one.
        """
        what, monitor = name_one(self.modality), TraceMonitor(name_one(self.modality))
        monitor.update(self.samples)
        warnings = list(monitor.quality(ranges, level=monitor.level).warnings)
        if self.source.lost:
            self.source.lost = False
            warnings.append(f"Samples of the {what} were lost; close other programs.")
        if self.source.timed and len(self._times) == 2:
            rate = self._arrived / (self._times[1] - self._times[0])
            if abs(rate / self.rate - 1) > TOLERANCE:
                warnings.append(
                    f"The {what} arrives at {rate:.0f} Hz, and record.{self.modality}.rate is "
                    f"{self.rate}; correct that, or the sensor."
                )
        return tuple(warnings)


QUIET_SECONDS = 0.5  # at first, in which nothing touches
RISE = 3.0  # times the level of that, above which something does
SILENT_SECONDS = 0.5  # below it, after which nothing does any more


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

    def update(self, value: float) -> None:
        """Take the level of the next chunk."""
        if len(self._quiet) < self._learn:
            self._quiet.append(value)
            return
        loud = value > RISE * float(np.median(self._quiet))
        self.silent = 0 if loud else self.silent + 1
        self.touching = loud or (self.touching and self.silent < self._patience)


Follow = Callable[[Chunk, float, bool], None]  # chunk, its level, whether it is recorded


class Session:
    """Fill the recordings of all signals, again and again.

    Args:
        signals: Signals of all senses; the first decides when a recording begins and ends.
        seconds: Length of a recording, or its limit.
        contact: Begins and ends recordings; None goes by time alone.
        follow: Is called with every chunk of the first signal.
    """

    def __init__(
        self, signals: Sequence[Signal], seconds: float, contact: Contact | None, follow: Follow
    ) -> None:
        self.signals, self.lead = signals, signals[0]
        self.seconds, self.contact, self.follow = seconds, contact, follow

    def record(self) -> bool:
        """Make the next recording.

        Returns:
            Whether the first source goes on; if not, the recording may be short or empty.

        Raises:
            UserError: If a source fails.
        """
        for signal in self.signals:
            signal.clear()
        try:
            return self._take()
        finally:  # also of an interrupt
            self._trim()

    def _take(self) -> bool:
        """Take chunks of all signals until the recording ends; return whether the first goes on."""
        contact = self.contact
        recorded = contact is None
        lifted = contact is None or not contact.touching  # since the last recording
        while not recorded or self.lead.seconds < self.seconds:
            chunks = [signal.next() for signal in self.signals]
            if chunks[0] is None:
                return False
            value = level(chunks[0])
            if contact is not None:
                contact.update(value)
                lifted = lifted or not contact.touching
                recorded = recorded or (lifted and contact.touching)
            if recorded:
                self._add(chunks)
            self.follow(chunks[0], value, recorded)
            if recorded and contact is not None and not contact.touching:
                break
        return True

    def _add(self, chunks: Sequence[Chunk | None]) -> None:
        for signal, chunk in zip(self.signals, chunks, strict=True):
            if chunk is not None:
                signal.add(chunk)

    def _trim(self) -> None:
        """Cut all recordings to one length, and off the silence at their end."""
        seconds = min(self.lead.seconds, self.seconds)
        if self.contact is not None:
            seconds -= self.contact.silent * self.lead.size / self.lead.rate
        for signal in self.signals:
            signal.cut(max(0, seconds))
