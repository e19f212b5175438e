"""Live classification through the command line."""

import io
import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import soundfile
from conftest import RATE, make_trace

from tex_lightning.inference.streaming.classifier import StreamingClassifier


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("run")


@pytest.fixture
def checkpoint(cli, surfaces, folder):
    path = folder / "checkpoints" / "haptic.ckpt"
    if not path.is_file():
        outcome = cli(
            "model=haptic",
            "data=folder",
            f"data.root={surfaces}",
            "debug=tiny",
            "trainer.threads=1",
            f"hydra.run.dir={folder}",
        )
        assert outcome.status == 0, outcome.err
    return path


def lines(outcome) -> list[dict]:
    assert outcome.status == 0, outcome.err
    return [json.loads(line) for line in outcome.out.splitlines()]


def test_a_replayed_file_ends_with_the_label_of_predict(cli, checkpoint, tmp_path):
    wav = tmp_path / "a.wav"
    soundfile.write(wav, make_trace(1, 42, seconds=3.05), RATE, subtype="FLOAT")
    common = [f"checkpoint={checkpoint}", f"haptic={wav}", f"hydra.run.dir={tmp_path / 'run'}"]
    said = lines(cli("task=stream", *common, "stream.chunk=0.25"))
    (whole,) = lines(cli("task=predict", *common))
    assert [line["time"] for line in said] == [*(0.25 * n for n in range(1, 13)), 3.05]
    assert said[0]["label"] is None
    assert said[0]["fragments"] == 0
    assert {key: said[-1][key] for key in ("label", "confidence", "fragments")} == {
        key: whole[key] for key in ("label", "confidence", "fragments")
    }


def test_labels_that_wait_for_no_computation_are_the_same(cli, checkpoint, tmp_path):
    wav = tmp_path / "a.wav"
    soundfile.write(wav, make_trace(1, 42, seconds=8.05), RATE, subtype="FLOAT")
    common = [f"checkpoint={checkpoint}", f"haptic={wav}", f"hydra.run.dir={tmp_path / 'run'}"]
    said = lines(cli("task=stream", *common))
    patient = lines(cli("task=stream", *common, "stream.wait=1"))
    assert [line["label"] for line in patient[: len(said)]] == [line["label"] for line in said]
    assert len(patient) == len(said) + 1  # the vote of all
    keys = ("time", "label", "confidence", "fragments")
    assert [patient[-1][key] for key in keys] == [said[-1][key] for key in keys]
    assert sum(line["fragments"] for line in patient[:-1]) < sum(line["fragments"] for line in said)


def pipe(monkeypatch, content: bytes) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(content)))


def test_samples_from_standard_input(cli, checkpoint, tmp_path, monkeypatch):
    samples = np.stack([make_trace(0, n, seconds=2.5) for n in range(3)])
    np.save(tmp_path / "a.npy", samples)
    pipe(monkeypatch, samples.T.astype("<f4").tobytes())
    common = [f"checkpoint={checkpoint}", f"hydra.run.dir={tmp_path / 'run'}"]
    said = lines(cli("task=stream", *common, "haptic=-", "stream.axes=3"))
    (whole,) = lines(cli("task=predict", *common, f"haptic={tmp_path / 'a.npy'}"))
    assert len(said) == 25
    assert (said[-1]["label"], said[-1]["fragments"]) == (whole["label"], whole["fragments"])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["haptic=/no.wav"], "/no.wav does not exist"),
        (["haptic=[a.wav,b.wav]"], "give one file"),
        (["haptic=-", "stream.axes=2"], "choose 1, 3"),
        (["haptic=-", "stream.chunk=0"], "stream.chunk is 0: choose more than 0"),
        (["haptic=-", "stream.wait=-1"], "stream.wait is -1: choose from 0 to 60"),
        (["haptic=-", "stream.wait=1", "decision.reject_below=0.5"], "set stream.wait=0"),
        (["haptic=-", "engine.precision=bf16"], "computed in float32"),
        (["haptic=-", "image=a.jpg"], "task=stream reads one signal"),
        (["haptic=-"], "record a longer stroke"),
        ([], "give haptic=FILE, or haptic=-"),
    ],
)
def test_mistakes_are_told(cli, checkpoint, tmp_path, monkeypatch, arguments, said):
    pipe(monkeypatch, b"")
    run = f"hydra.run.dir={tmp_path / 'run'}"
    outcome = cli("task=stream", f"checkpoint={checkpoint}", run, *arguments)
    assert outcome.status == 2
    assert said in outcome.err
    assert "Traceback" not in outcome.err


def test_ctrl_c_ends_it_as_elsewhere(cli, checkpoint, surfaces, tmp_path, monkeypatch):
    push = StreamingClassifier.push

    def interrupted(self, chunk):
        if self.frames > 100:
            raise KeyboardInterrupt
        return push(self, chunk)

    monkeypatch.setattr(StreamingClassifier, "push", interrupted)
    wav, run = surfaces / "alpha" / "haptic" / "alpha_0.wav", f"hydra.run.dir={tmp_path / 'run'}"
    outcome = cli("task=stream", f"checkpoint={checkpoint}", f"haptic={wav}", run)
    assert outcome.status == 130
    assert len(outcome.out.splitlines()) == 11
    assert "epoch" not in outcome.err


def test_not_a_number_on_standard_input_is_refused(cli, checkpoint, tmp_path, monkeypatch):
    pipe(monkeypatch, np.full(5000, np.nan, "<f4").tobytes())
    run = f"hydra.run.dir={tmp_path / 'run'}"
    outcome = cli("task=stream", f"checkpoint={checkpoint}", "haptic=-", run)
    assert outcome.status == 2
    assert "NaN, infinity or a huge number at sample 0" in outcome.err


def test_a_label_that_is_not_sure_is_rejected_as_in_predict(cli, checkpoint, tmp_path):
    wav = tmp_path / "a.wav"
    soundfile.write(wav, make_trace(1, 42, seconds=3.05), RATE, subtype="FLOAT")
    common = [f"checkpoint={checkpoint}", f"haptic={wav}", f"hydra.run.dir={tmp_path / 'run'}"]
    said = lines(cli("task=stream", *common, "decision.reject_below=1"))
    (whole,) = lines(cli("task=predict", *common, "decision.reject_below=1"))
    assert (whole["label"], whole["rejected"]) == (None, True)
    assert (said[-1]["label"], said[-1]["rejected"]) == (None, True)
    assert said[0]["rejected"] is False
