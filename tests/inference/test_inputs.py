"""Folders, patterns and lists of files for prediction, through the command line."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import RATE, make_photo, make_trace
from PIL import Image

from tex_lightning.errors import UserError
from tex_lightning.inference.inputs import match_files


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("inputs")
    for place in ("traces", "photos"):
        (root / place).mkdir()
    for number in (10, 2, 1):
        wav = root / "traces" / f"s{number}.wav"
        soundfile.write(wav, make_trace(0, number), RATE, subtype="FLOAT")
        Image.fromarray(make_photo(0, number)).save(root / "photos" / f"s{number}.png")
    (root / "traces" / "notes.md").write_text("no trace")
    (root / "my file [1].wav").write_bytes((root / "traces" / "s1.wav").read_bytes())
    return root


def predict(cli, untrained, *arguments):
    return cli("task=predict", f"checkpoint={untrained}", "top_k=1", *arguments)


def names(outcome, key="haptic") -> list[str]:
    return [Path(json.loads(line)[key]).name for line in outcome.out.splitlines()]


def test_folders_patterns_and_lists(cli, untrained, folder, monkeypatch, tmp_path):
    monkeypatch.chdir(folder)
    common = [f"hydra.run.dir={tmp_path}"]
    every = ["s1.wav", "s2.wav", "s10.wav"]
    assert names(predict(cli, untrained, "haptic=traces", *common)) == every
    assert names(predict(cli, untrained, "haptic=traces/s1*.wav", *common)) == ["s1.wav", "s10.wav"]
    both = predict(cli, untrained, "haptic=[traces/s2.wav,traces]", *common)
    assert names(both) == ["s2.wav", *every]
    odd = predict(cli, untrained, "haptic=my file [1].wav", *common)
    assert names(odd) == ["my file [1].wav"], odd.err
    paired = predict(cli, untrained, "haptic=[traces/s10.wav,traces/s1.wav]", "image=photos/s1*")
    assert (names(paired), names(paired, "image")) == (["s10.wav", "s1.wav"], ["s10.png", "s1.png"])


def test_a_bad_file_does_not_take_the_others_along(cli, untrained, folder, tmp_path):
    (tmp_path / "bad.csv").write_text("no numbers")
    np.savez(tmp_path / "archive.npz", x=np.ones(30_000))
    (tmp_path / "archive.npz").rename(tmp_path / "archive.npy")
    files = f"haptic=[{tmp_path}/bad.csv,{folder}/traces,{tmp_path}/archive.npy]"
    outcome = predict(cli, untrained, files)
    assert outcome.status == 2
    assert names(outcome) == ["s1.wav", "s2.wav", "s10.wav"]
    assert "Error: 2 of 5 samples could not be classified:" in outcome.err
    assert "bad.csv cannot be read" in outcome.err
    assert "archive.npy cannot be read (it is an .npz archive" in outcome.err
    assert "Traceback" not in outcome.err


def test_what_gives_no_files_is_said(cli, untrained, folder):
    for value in (folder / "photos", folder / "traces" / "x*.wav"):
        outcome = predict(cli, untrained, f"haptic={value}")
        assert outcome.status == 2
        assert "gives no file of a known type" in outcome.err
    some = predict(cli, untrained, f"haptic={folder}/traces", f"image={folder}/photos/s1*")
    assert "3 traces and 2 photos; give as many of each" in some.err


def test_stems_decide_where_they_are_the_same_and_else_the_order():
    given = {
        "haptic": [Path("a.wav"), Path("b.wav")],
        "image": [Path("b.png"), Path("a.png")],
        "sound": [Path("b.flac"), Path("a.flac")],
    }
    stems = [{name: path.stem for name, path in each.items()} for each in match_files(given)]
    assert stems == [dict.fromkeys(given, stem) for stem in "ab"]
    others = [Path("x.png"), Path("y.png")]
    in_order = match_files({**given, "image": others})
    assert [each["image"] for each in in_order] == others
    assert match_files({"haptic": [], "sound": given["sound"]}) == [
        {"sound": Path("b.flac")},
        {"sound": Path("a.flac")},
    ]
    with pytest.raises(UserError, match="2 traces and 3 photos; give as many of each"):
        match_files({"haptic": given["haptic"], "image": [*others, Path("z.png")]})
    with pytest.raises(UserError, match="nothing to classify"):
        match_files({"haptic": []})


def test_a_reader_that_has_enough_ends_a_stream_quietly(untrained, folder, tmp_path):
    command = [sys.executable, "-m", "tex_lightning", "task=stream", "stream.chunk=0.001"]
    command += [f"checkpoint={untrained}/checkpoints/haptic.ckpt", "trainer.threads=1"]
    command += [f"haptic={folder}/traces/s1.wav", f"hydra.run.dir={tmp_path}"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ)
    ) as process:
        assert json.loads(process.stdout.readline())["time"] == 0.001
        process.stdout.close()
        complaint = process.stderr.read()
    assert complaint == ""
    assert process.returncode == 141  # as a shell says of what SIGPIPE ended
