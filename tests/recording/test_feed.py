"""Chunks of one length, and when they came."""

from types import SimpleNamespace

import numpy as np
import pytest

from tex_lightning.recording import feed as feed_module
from tex_lightning.recording.feed import Feed
from tex_lightning.recording.sources import Source


class Pieces(Source):
    """Pieces of a ramp, each so many seconds after the one before."""

    rate = 100

    def __init__(self, sizes, seconds, clock):
        self.sizes, self.seconds, self.clock = sizes, seconds, clock

    def chunks(self):
        place = 0
        for size in self.sizes:
            self.clock[0] += self.seconds
            yield None
            yield np.arange(place, place + size, dtype=np.float32)[None]
            place += size


@pytest.mark.parametrize("timed", [True, False])
def test_pieces_become_chunks_and_their_rate_is_measured(monkeypatch, timed):
    clock = [100.0]
    monkeypatch.setattr(feed_module, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    source = Pieces([3, 25, 0, 7, 1, 30], 0.25, clock)
    source.timed = timed
    with Feed("haptic=-", source, 0.1, 1) as feed:
        found = [feed.next() for _ in range(7)]
        assert feed.next() is None  # it stays the end
    assert [chunk.shape[1] for chunk in found] == [10] * 6 + [6]
    np.testing.assert_array_equal(np.concatenate(found, axis=1)[0], np.arange(66))
    assert feed.arrival_rate == (63 / 1.25 if timed else None)
