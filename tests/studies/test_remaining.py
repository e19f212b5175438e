import time

import pytest

from tex_lightning.studies.remaining import Remaining, format_seconds


def test_estimate_is_of_what_was_measured(monkeypatch):
    clock = iter([0.0, 10.0, 10.0, 14.0])
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    left = [("a", (0, 5)), ("a", (1, 6)), ("b", (0, 5)), ("b", (1, 6))]
    remaining = Remaining(["a", "b"], left)
    assert remaining.seconds_left() is None
    with remaining.measuring("a", (0, 5)):
        pass
    assert remaining.seconds_left() == 10 + 2 * 10  # b is expected to take as long as a
    remaining.left.remove(("a", (1, 6)))  # as if it had been there
    with remaining.measuring("b", (0, 5)):
        pass
    assert remaining.seconds_left() == 4


@pytest.mark.parametrize(
    ("seconds", "text"), [(42.4, "42 s"), (61, "1 min"), (3000, "50 min"), (9000, "2.5 h")]
)
def test_length_of_time_in_words(seconds, text):
    assert format_seconds(seconds) == text
