"""Decisions of finished trials on disk."""

import re

import pytest

from tex_lightning.errors import UserError
from tex_lightning.stability.evaluator import Decision
from tex_lightning.stability.record import Record

KEY = ("haptic", "noise", 3.0)
MADE = [Decision(2, 0.5)]


def test_finished_trials_are_read_again_and_a_line_cut_off_is_not(tmp_path):
    path = tmp_path / "trials.jsonl"
    Record(path).add(KEY, MADE)
    with path.open("a") as stream:
        stream.write('["haptic", "noise", 4.0')
    assert Record(path).trials == {KEY: MADE}
    assert len(path.read_text().splitlines()) == 1


@pytest.mark.parametrize(
    "line", ["{", "[1, 2]", "3", '["haptic", "noise", 4.0, [[1, 2, 3, 4, 5, 6]]]']
)
def test_a_damaged_line_is_named(tmp_path, line):
    path = tmp_path / "trials.jsonl"
    Record(path).add(KEY, MADE)
    with path.open("a") as stream:
        stream.write(line + "\n")
    with pytest.raises(UserError, match=re.escape(f"Line 2 of {path} is damaged")):
        Record(path)
