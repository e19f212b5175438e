"""Folders, patterns and lists of files for prediction."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import RATE, make_trace

from tex_lightning.data.readers.given_files import find_files, match_files
from tex_lightning.errors import UserError


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("inputs")
    for name in ("s10.wav", "s2.wav", "s1.wav"):
        soundfile.write(root / name, make_trace(0, len(name)), RATE, subtype="FLOAT")
    (root / "notes.md").write_text("no trace")
    odd = root / "odd" / "my file [1].wav"
    odd.parent.mkdir()
    odd.write_bytes((root / "s1.wav").read_bytes())
    return root


def test_folders_patterns_and_lists(folder):
    def names(value: object) -> list[str]:
        return [path.name for path in find_files("haptic", value)]

    assert names(str(folder)) == ["s1.wav", "s2.wav", "s10.wav"]
    assert names(f"{folder}/s1*.wav") == ["s1.wav", "s10.wav"]
    assert names([f"{folder}/s2.wav", str(folder)]) == ["s2.wav", "s1.wav", "s2.wav", "s10.wav"]
    assert names(f"{folder}/odd/my file [1].wav") == ["my file [1].wav"]
    assert names(None) == []
    with pytest.raises(UserError, match="gives no file of a known type"):
        find_files("image", str(folder))


def test_a_bad_file_does_not_take_the_others_along(cli, untrained, folder, tmp_path):
    (tmp_path / "bad.csv").write_text("no numbers")
    np.savez(tmp_path / "archive.npz", x=np.ones(30_000))
    (tmp_path / "archive.npz").rename(tmp_path / "archive.npy")
    files = f"haptic=[{tmp_path}/bad.csv,{folder},{tmp_path}/archive.npy]"
    outcome = cli("task=predict", f"checkpoint={untrained}", files)
    assert outcome.status == 2
    said = [Path(json.loads(line)["haptic"]).name for line in outcome.out.splitlines()]
    assert said == ["s1.wav", "s2.wav", "s10.wav"]
    assert "Error: 2 of 5 samples could not be classified:" in outcome.err
    assert "bad.csv holds no numbers" in outcome.err
    assert "archive.npy cannot be read (it is an .npz archive" in outcome.err


def test_stems_decide_where_they_are_the_same_and_else_the_order():
    files = {
        "haptic": [Path("a.wav"), Path("b.wav")],
        "image": [Path("b.png"), Path("a.png")],
        "sound": [Path("b.flac"), Path("a.flac")],
    }
    stems = [{name: path.stem for name, path in each.items()} for each in match_files(files)]
    assert stems == [dict.fromkeys(files, stem) for stem in "ab"]
    others = [Path("x.png"), Path("y.png")]
    in_order = match_files({**files, "image": others})
    assert [each["image"] for each in in_order] == others
    with pytest.raises(UserError, match="2 traces and 3 photos; give as many of each"):
        match_files({"haptic": files["haptic"], "image": [*others, Path("z.png")]})
    with pytest.raises(UserError, match="2 traces and 1 photo; give as many of each"):
        match_files({"haptic": files["haptic"], "image": others[:1]})
    with pytest.raises(UserError, match="nothing to classify"):
        match_files({"haptic": []})
