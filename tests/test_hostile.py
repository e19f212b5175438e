"""Bombs, claims, code, pipes and devices through the command line."""

import pytest

from benchmarks.hostile import run_all


@pytest.mark.slow
def test_each_ends_with_status_2_and_a_sentence_in_little_memory():
    found = run_all()
    assert "process" not in found  # nothing crashed, and no code of a file has run
    assert {name: each["wrong"] for name, each in found.items() if each["wrong"]} == {}
    assert len(found) > 10
    assert max(each["mebibytes"] for each in found.values()) < 200
