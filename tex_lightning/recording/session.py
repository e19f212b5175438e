"""One recording of several senses at once, by time or by contact."""

from collections.abc import Callable, Sequence

from tex_lightning.recording.contact import Contact, level
from tex_lightning.recording.parsing import Chunk
from tex_lightning.recording.track import Track

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
