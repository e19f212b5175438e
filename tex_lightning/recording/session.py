"""One recording of several senses at once, by time or by contact.

Every source is read in a thread of its own, so that no sensor waits for another or for a network.
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
        self._times: list[float] = []  # of the first samples, which are not counted, and the last
        self._count = 0

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
        if not self.source.timed or len(self._times) < 2:
            return None
        return self._count / (self._times[-1] - self._times[0])

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
            self._count += piece.shape[1] if self._times else 0
            self._times[1:] = [time.monotonic()]
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
        what, monitor = name_one(self.modality), TraceMonitor(name_one(self.modality))
        monitor.update(self.samples)
        found = list(monitor.quality(ranges, level=monitor.level).warnings)
        values = [len(np.unique(axis)) for axis in self.samples]
        if 1 < min(values) < FEW_VALUES:
            found.append(
                f"The {what} is too quiet: it has only {min(values)} different values; raise the "
                "sensor's gain."
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

    @property
    def ready(self) -> bool:
        """Whether the level of quiet is known."""
        return len(self._quiet) == self._learn

    def update(self, value: float) -> None:
        """Take the level of the next chunk."""
        if not self.ready:
            self._quiet.append(value)
            return
        loud = value > RISE * float(np.median(self._quiet))
        self.silent = 0 if loud else self.silent + 1
        self.touching = loud or (self.touching and self.silent < self._patience)


Follow = Callable[[Chunk, float, bool], None]  # chunk, its level, whether it is recorded


class Session:
    """Fill tracks, again and again.

    Args:
        tracks: Tracks of all senses; the first decides when a recording begins and ends.
        seconds: Length of a recording, or the most of it.
        contact: Begins and ends recordings; None goes by time alone.
        follow: Is told every chunk of the first track.
    """

    def __init__(
        self, tracks: Sequence[Track], seconds: float, contact: Contact | None, follow: Follow
    ) -> None:
        self.lead, *self.others = tracks
        self.seconds, self.contact, self.follow = seconds, contact, follow

    def record(self) -> bool:
        """Fill the tracks with the next recording.

        Returns:
            Whether the first source goes on; if not, the recording may be short or empty.

        Raises:
            UserError: If a source fails.
        """
        for track in (self.lead, *self.others):
            track.clear()
        self.start = self.lead.feed.taken  # chunks before the recording
        most = round(self.seconds * self.lead.rate)
        goes_on = self.contact is None or self._wait(self.contact, most)
        while goes_on and self.lead.count < most:
            goes_on = self._take(most)
            if self.contact is not None and not self.contact.touching:
                break
        if self.contact is not None:  # what was silent at the end
            silent = self.contact.silent * self.lead.feed.size
            self.lead.cut(max(0, self.lead.count - silent))
        for other in self.others:
            self._fill(other, self.lead.seconds)
        return goes_on

    def _wait(self, contact: Contact, most: int) -> bool:
        """Wait until the tool is lifted and touches again; what is before is forgotten."""
        lifted = not contact.touching
        while (chunk := self.lead.feed.next()) is not None:
            for other in self.others:
                self._skip(other, self.lead.feed.taken - 1, wait=False)
            value = level(chunk)
            contact.update(value)
            lifted = lifted or not contact.touching
            begins = lifted and contact.touching
            self.follow(chunk, value, begins)
            if begins:
                self.start = self.lead.feed.taken - 1
                self.lead.add(chunk, most)
                return True
        return False

    def _take(self, most: int) -> bool:
        """Record the next chunk of the first track, and what the others have by now."""
        chunk = self.lead.feed.next()
        if chunk is None:
            return False
        self.lead.add(chunk, most)
        value = level(chunk)
        if self.contact is not None:
            self.contact.update(value)
        for other in self.others:
            self._fill(other, self.lead.seconds, wait=False)
        self.follow(chunk, value, True)
        return True

    def _skip(self, other: Track, place: int, *, wait: bool) -> None:
        """Forget chunks of another track up to a place, so that it stays beside the first."""
        while other.feed.taken < place and (wait or other.feed.ready):
            if other.feed.next() is None:
                return

    def _fill(self, other: Track, seconds: float, *, wait: bool = True) -> None:
        """Bring another track to a length, or take what is there."""
        most = round(seconds * other.rate)
        self._skip(other, self.start, wait=wait)
        if other.feed.taken < self.start:
            return
        while other.count < most and (wait or other.feed.ready):
            chunk = other.feed.next()
            if chunk is None:
                return
            other.add(chunk, most)
        if wait:
            other.cut(most)
