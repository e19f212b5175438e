"""Damaged files of every format: accepted with finite numbers, or refused in one sentence."""

import pytest

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

    monkeypatch.setattr("tex_lightning.data.traces.axes_first", break_reading)
    with pytest.raises(RuntimeError, match="npy is refused whole: "):
        next(attempts("npy", 1, tmp_path))
