"""Damaged and hostile files: accepted with finite numbers, or refused in one sentence."""

import pytest

from benchmarks.hostile import run_all
from benchmarks.mutations import COUNT, FORMATS, attempts, tally


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_every_reader_accepts_or_refuses_every_damaged_file(name):
    found = tally(name, COUNT)
    assert found.wrong == []
    assert found.tried == found.accepted + found.refused == COUNT
    assert found.worst_seconds < 10
    assert found.worst_mebibytes < 100


def test_what_a_reader_does_wrong_is_told(tmp_path, monkeypatch):
    def break_reading(*_: object) -> None:
        print("library")
        raise KeyError("inside")

    monkeypatch.setattr("tex_lightning_runtime.traces.axes_first", break_reading)
    with pytest.raises(RuntimeError, match="npy is refused whole: "):
        next(attempts("npy", 1, tmp_path))


@pytest.mark.slow
def test_bombs_claims_code_pipes_and_devices_end_with_status_2_and_a_sentence_in_little_memory():
    found = run_all()
    assert "process" not in found  # nothing crashed, and no code of a file has run
    assert {name: each["wrong"] for name, each in found.items() if each["wrong"]} == {}
    assert len(found) > 10
    assert max(each["mebibytes"] for each in found.values()) < 200
